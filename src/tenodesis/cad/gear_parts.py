"""Parts of a joint of gears at either end of the stem."""

import math

from tenodesis.cad import kernel as k
from tenodesis.cad.gear_joint import GearJoint, bored, link, toothed_half
from tenodesis.cad.kernel import FLIP
from tenodesis.cad.parts import Dimension, Part, pin
from tenodesis.cad.shared import (
    End,
    far_dimensions,
    ferrule,
    ferrule_collar,
    ferrule_pockets,
    sheath_seats,
    socket,
    spigot,
    transition,
    tube_dimensions,
)
from tenodesis.cad.sizes import Sizes


def gear_parts(joint: GearJoint, end: End, sizes: Sizes) -> list[Part]:
    """Return the parts of a gear pair at the tip or at the handle."""
    tip = end.tip
    names = tuple(f"{'tip' if tip else 'handle'}_{kind}" for kind in ("gear_near", "gear_far", "link", "pin"))
    titles = (
        ("Gear on the stem", "Gear of the end-effector", "Link of the tip")
        if tip
        else ("Gear at the stem's handle end", "Gear of the grip", "Link of the handle")
    )
    density = sizes.process.density
    side = joint.outside + joint.play
    places = tuple(k.at(0, y) if tip else k.at(0, -y, turn=FLIP) for y in (side, -side - joint.link_thickness))
    radius = joint.gear.pitch_radius
    pins = tuple(k.at(z=z if tip else -z) for z in (0.0, 2 * radius))
    dowel = k.rod((0, -joint.pin_length / 2, 0), (0, joint.pin_length / 2, 0), joint.pin / 2)
    out = 2.5 * radius
    return [
        Part(
            names[0],
            titles[0],
            _near(joint, end, sizes),
            "stem",
            (k.at() if tip else k.at(z=-end.stem_length, turn=FLIP),),
            density=density,
            dimensions=_half_dimensions(joint, end, sizes, near=True),
            notes=_notes(joint),
        ),
        Part(
            names[1],
            titles[1],
            _far(joint, end, sizes),
            end.far,
            (k.at(turn=FLIP) if tip else k.at(),),
            density=density,
            dimensions=_half_dimensions(joint, end, sizes, near=False),
            notes=_notes(joint),
            away=(0, 0, out if tip else -out),
        ),
        Part(
            names[2],
            titles[2],
            link(joint, sizes),
            end.carrier,
            places,
            density=density,
            dimensions=_link_dimensions(joint, sizes, end.key),
            away=(0, out, out / 2 if tip else -out / 2),
        ),
        pin(
            names[3], joint.pin, joint.pin_length, dowel, end.carrier, pins, (0, 2 * out, out / 2 if tip else -out / 2)
        ),
    ]


def _near(joint: GearJoint, end: End, sizes: Sizes) -> k.Solid:
    radius, stem = joint.gear.pitch_radius, end.stem_radius
    body = toothed_half(joint, tooth_ahead=True)
    top = -joint.depth
    if end.tip:
        body += k.rod((0, 0, top - joint.collar), (0, 0, top), stem)
        body += spigot(end, sizes, top - joint.collar)
        return bored(joint, body, sizes, joint.depth + joint.collar)
    ways = [((x, 0.0), (math.copysign(end.tendon_radius, x), 0.0)) for x in (-radius, radius)]
    body += transition(end, sizes, joint.width, joint.middle, top, ways)[0]
    body = bored(joint, body, sizes, joint.depth)
    for tunnel in transition(end, sizes, joint.width, joint.middle, top, ways)[1]:
        body -= tunnel
    return body + spigot(end, sizes, -end.near_length)


def _far(joint: GearJoint, end: End, sizes: Sizes) -> k.Solid:
    radius, top = joint.gear.pitch_radius, -joint.depth
    body = toothed_half(joint, tooth_ahead=False)
    bottom = top - end.far_collar
    if end.tip:
        body += k.rod((0, 0, bottom), (0, 0, top), ferrule_collar(radius, end, sizes))
        body = bored(joint, body, sizes, joint.depth + end.far_collar)
        body -= ferrule_pockets(radius, sizes, bottom, end.far_collar)
    else:
        reach = radius + end.seat + sizes.wall
        deep = max(end.seat, (end.rod + sizes.bore) / 2) + sizes.wall
        body += k.box((-reach, reach), (-deep, deep), (bottom, top))
        body = bored(joint, body, sizes, joint.depth + end.far_collar)
        body -= sheath_seats(radius, end, sizes, bottom)
    return body - socket(end, sizes, bottom)


def _notes(joint: GearJoint) -> tuple[str, ...]:
    gear, rope = joint.gear, joint.rope
    return (
        f"Gear: module {gear.module:.4g} mm, {gear.teeth} teeth, 20 deg, no profile shift; "
        f"tooth thickness less {gear.backlash / 2:.3g} mm.",
        f"Tunnels Ø{joint.tunnel:.3g} for a rope of {rope:.3g} mm; their ends at the gear's axis have a sharp edge.",
        "Radius to the rope's centre = pitch radius = tunnel's axis.",
    )


def _half_dimensions(joint: GearJoint, end: End, sizes: Sizes, *, near: bool) -> tuple[Dimension, ...]:
    gear, y = joint.gear, -joint.outside
    radius, bore = gear.pitch_radius, (joint.pin + sizes.bore) / 2
    bottom = -joint.depth - end.far_collar
    wide, _ = ferrule(sizes)
    own = (
        Dimension("radius to the rope's centre", (0, y, 0), (radius, y, 0), "front", 1, "R", end.key),
        Dimension("tip circle", (0, y, 0), (0, y, gear.tip_radius), "front", -1, "R", along="y"),
        Dimension("tunnels apart", (-radius, 0, 0), (radius, 0, 0), "top", 1, "", end.key, 2),
        Dimension("over the toothed plates", (0, -joint.outside, 0), (0, joint.outside, 0), "side", 1),
        Dimension("between the toothed plates", (0, -joint.middle, 0), (0, joint.middle, 0), "side", 1),
        Dimension("pin's bore", (-bore, y, 0), (bore, y, 0), "front", 1, "Ø"),
    )
    if near:
        return own + tube_dimensions(end, sizes)
    pocket = wide if end.tip else end.seat
    name = "ferrule's pocket" if end.tip else "sheath's seat"
    ends = Dimension(name, (radius - pocket, 0, bottom), (radius + pocket, 0, bottom), "top", 1, "Ø")
    return (*own, *far_dimensions(end, sizes, bottom), ends)


def _link_dimensions(joint: GearJoint, sizes: Sizes, key: str) -> tuple[Dimension, ...]:
    apart, bore = 2 * joint.gear.pitch_radius, (joint.pin + sizes.bore) / 2
    return (
        Dimension("distance of the axes", (0, 0, 0), (0, 0, apart), "front", -1, key=key, factor=2, along="y"),
        Dimension("bore", (-bore, 0, apart), (bore, 0, apart), "front", 1, "Ø"),
        Dimension("width", (-joint.link, 0, 0), (joint.link, 0, 0), "front", -1),
        Dimension("thickness", (0, 0, 0), (0, joint.link_thickness, 0), "side", 1),
    )
