"""A planar instrument as solids: its parts, from the instrument's file and a process."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tenodesis import kinematics
from tenodesis.cad import kernel as k
from tenodesis.cad.backbone_parts import Backbone, backbone, backbone_parts
from tenodesis.cad.bench_parts import (
    Hardware,
    Rig,
    drive_parts,
    end_effector_part,
    grip_part,
    rig_parts,
    stem_part,
    tip_pin_part,
)
from tenodesis.cad.gears import Gear, GearJoint, gear_joint, gear_parts
from tenodesis.cad.parts import End, Part, Process, Sizes, ferrule, refuse, transition_length
from tenodesis.cad.parts import process as process_of
from tenodesis.cad.pulley_parts import PulleyJoint, pulley_joint, pulley_parts
from tenodesis.errors import InstrumentError
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.kinematics import Posture
from tenodesis.scaling import catalogue as catalogues

_MODULES = (0.1e-3, 0.12e-3, 0.15e-3, 0.2e-3, 0.25e-3)
"""Modules below the catalogue's, of gears that are made for the purpose, m (JIS B 1701-2 series I, not looked up)."""
_LEAST_TEETH = 12
_CABLE_RADIUS = 15e-3  # m, the paper's load rig
_RODS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
_MACHINE_ROUNDING = 1e-6


@dataclass(frozen=True)
class Model:
    """The solids of a planar instrument; use :func:`build`."""

    given: ShortForm
    """The instrument as it was given, with all its axes."""
    instrument: ShortForm
    """Its bending axis that was built, called yaw."""
    axis: str
    """Name of that axis in the instrument given."""
    process: Process
    parts: tuple[Part, ...]
    joints: "tuple[GearJoint | PulleyJoint | Backbone, GearJoint | PulleyJoint]"
    """At the tip and at the handle."""
    rig: Rig
    stop: float
    """Output angle up to which the distal joint was sized, rad."""

    def part(self, name: str) -> Part:
        """Return a part by its name. Raises KeyError if there is none."""
        found = next((part for part in self.parts if part.name == name), None)
        if found is None:
            raise KeyError(name)
        return found


def build(
    inst: InstrumentLike,
    *,
    process: str | Process = "sla",
    axis: str | None = None,
    modules: Mapping[str, float] | None = None,
    hardware: Hardware | None = None,
    rig: bool = True,
) -> Model:
    """Return the solids of one bending axis of an instrument on its bench.

    Parameters
    ----------
    inst
        The instrument.
    process
        How its parts are made: fdm, sla, milled, or a process of your own.
    axis
        Which bending axis; by default the first. The bench of Fig. 13 has one axis.
    modules
        Modules of gears by end, "distal" and "proximal", m; by default the largest of the standard catalogue and then
        of finer series with a whole number of teeth, at least 12.
    hardware
        Motors, load cells, sheaths and bearings, which are bought.
    rig
        Whether to add the load rig, the drives and their mounts.

    Raises
    ------
    InstrumentError
        A dimension cannot be made: radii that fit no whole number of teeth, walls thinner than the process allows, a
        joint that touches before its range; the message names the dimension, its value and what would do.
    MissingExtraError
        build123d is not installed.
    """
    given = as_short_form(inst)
    axis = axis or given.axes[0]
    planar = given.axis(axis)
    if planar.axes != ("yaw",):
        planar = planar.replace(axes=("yaw",))
    chosen = process_of(process)
    bought = hardware or Hardware()
    if planar.tendon_diameter is None:
        raise InstrumentError(
            f"{planar.name} has no tendon_diameter; tunnels and grooves need it: give it, 0.5 mm say.",
            key="tendon_diameter",
            allowed="given",
        )
    sizes = Sizes(chosen, k.MM * planar.tendon_diameter)
    stop = min(planar.output_stop, planar.output_range + math.radians(10))
    teeth = dict(modules or {})
    tip_joint, hand_joint = _joints(planar, sizes, bought, teeth, stop)
    tip, hand = _ends(planar, sizes, bought, tip_joint, hand_joint)
    foot = _foot(tip_joint, sizes)
    length = k.MM * planar.end_effector_length
    if foot + tip.far_collar + 4 > length:
        refuse(
            "end_effector_length",
            length,
            f"the far half of the joint takes {foot + tip.far_collar:.3g} mm of it",
            f"at least {foot + tip.far_collar + 4:.3g} mm",
        )
    parts: list[Part] = []
    for joint, end in ((tip_joint, tip), (hand_joint, hand)):
        if isinstance(joint, GearJoint):
            parts += gear_parts(joint, end, sizes)
        elif isinstance(joint, PulleyJoint):
            parts += pulley_parts(joint, end, sizes)
        else:
            parts += backbone_parts(joint, end, sizes)
    parts.append(stem_part(tip, hand))
    where = _rig(planar, tip, tip_joint, hand_joint)
    parts.append(end_effector_part(tip, sizes, length, foot))
    parts.append(grip_part(hand, sizes, k.MM * planar.handle_length, _foot(hand_joint, sizes)))
    if rig:
        parts.append(tip_pin_part(tip, length, -where.level - 4.0))
        parts += rig_parts(where, sizes, bought, tip.stem_radius)
        lengths = kinematics.dimensions(planar)
        behind = -k.MM * (lengths.stem_length + 1.4 * lengths.handle_length) - 120
        parts += drive_parts(sizes, bought, k.MM * planar.drives.spool_radius, behind)
    parts = [part if part.density else replace(part, density=chosen.density) for part in parts]
    return Model(given, planar, axis, chosen, tuple(parts), (tip_joint, hand_joint), where, stop)


def gear_of(key: str, radius: float, module: float | None = None) -> tuple[float, int]:
    """Return module, m, and number of teeth of gears of a pitch radius, m.

    Raises InstrumentError if no module has a whole number of teeth, and names the nearest radius that has.
    """
    stock = catalogues.load().gears
    series = sorted({*_MODULES, *(stock.modules if stock else ())}) if module is None else [module]
    nearest: tuple[float, float, int] | None = None
    for one in reversed(series):
        teeth = 2 * radius / one
        whole = max(round(teeth), _LEAST_TEETH)
        if abs(teeth - whole) < _MACHINE_ROUNDING * whole:
            return one, whole
        off = abs(one * whole / 2 - radius)
        if nearest is None or off < nearest[0] - 1e-12:
            nearest = (off, one, whole)
    assert nearest is not None
    _, one, whole = nearest
    return refuse(
        key,
        k.MM * radius,
        "no gear has that pitch radius"
        if module is None
        else f"gears of module {k.MM * module:.4g} mm have no such pitch radius",
        f"half a module times a whole number of teeth, such as {k.MM * one * whole / 2:.6g} mm (module "
        f"{k.MM * one:.4g} mm, {whole} teeth)",
    )


def _joints(
    inst: ShortForm, sizes: Sizes, bought: Hardware, modules: Mapping[str, float], stop: float
) -> "tuple[GearJoint | PulleyJoint | Backbone, GearJoint | PulleyJoint]":
    play = k.MM * sizes.process.backlash
    hand_stop = inst.handle_range + math.radians(5)
    if inst.joint_type == "tendon-gear":
        found = []
        for end, key, most in (
            ("distal", "distal_gear_radius", stop),
            ("proximal", "proximal_gear_radius", hand_stop),
        ):
            radius = getattr(inst, key)
            module, teeth = gear_of(key, radius, modules.get(end))
            found.append(gear_joint(sizes, key, k.MM * radius, Gear(k.MM * module, teeth, play), most))
        return found[0], found[1]
    seat = _seat(sizes, bought)
    hand = pulley_joint(sizes, "proximal_pulley_radius", k.MM * inst.proximal_pulley_radius, hand_stop, seat)
    if inst.joint_type == "tendon-pulley":
        return pulley_joint(sizes, "distal_pulley_radius", k.MM * inst.distal_pulley_radius, stop, None), hand
    rod = (64 * inst.backbone_rigidity / (math.pi * 60e9)) ** 0.25
    tip = backbone(sizes, k.MM * inst.distal_tendon_offset, k.MM * inst.backbone_length, k.MM * rod, stop)
    return tip, hand


def _seat(sizes: Sizes, bought: Hardware) -> float:
    return (k.MM * bought.sheath + sizes.bore) / 2


def _ends(
    inst: ShortForm,
    sizes: Sizes,
    bought: Hardware,
    tip: "GearJoint | PulleyJoint | Backbone",
    hand: "GearJoint | PulleyJoint",
) -> tuple[End, End]:
    lengths = kinematics.dimensions(inst)
    stem = k.MM * lengths.stem_diameter / 2
    radius, shift = k.MM * lengths.distal_radii[0], tip.shift if isinstance(tip, PulleyJoint) else 0.0
    needed = math.hypot(radius, shift) + sizes.rope / 2 + 0.02
    if stem - needed < sizes.process.wall * k.MM / 2 and stem - needed < 0.15:
        refuse(
            "stem_diameter",
            2 * stem,
            f"tendons of {sizes.rope:.3g} mm at {radius:.4g} mm from its axis leave {max(stem - needed, 0.0):.3g} mm "
            "for the tube's wall",
            f"at least {2 * (needed + 0.15):.3g} mm",
        )
    bore = max(needed, stem - max(1.0, 0.05 * stem))
    wide, _ = ferrule(sizes)
    room = 2 * (radius - wide - sizes.wall) - sizes.bore
    most = min(0.75 * radius, room) if not isinstance(tip, PulleyJoint) else 0.8 * radius
    rods = [rod for rod in _RODS if rod <= most]
    if not rods:
        refuse(
            next(key for key, name in inst.parameter_fields.items() if name == "distal_radius"),
            radius,
            f"no rod of {_RODS[0]:g} mm for the end-effector fits between the tendons' ends",
            f"at least {wide + sizes.wall + (_RODS[0] + sizes.bore) / 2:.3g} mm",
        )
    seat = _seat(sizes, bought)
    far = "yaw_far"
    near_tip = tip.collar if isinstance(tip, Backbone) else tip.depth + tip.collar
    collar = max(tip.collar, 1.5 * rods[-1])
    key = {name: key for key, name in inst.parameter_fields.items()}
    stem_length = k.MM * lengths.stem_length
    big = k.MM * lengths.proximal_radii[0]
    slant = transition_length(big, radius) + min(stem, 15.0) + stem / 2
    near_hand = hand.depth + hand.collar + slant
    if near_tip + near_hand + 3 * stem > stem_length:
        refuse(
            "overall_length",
            k.MM * inst.overall_length,
            f"of the stem's {stem_length:.4g} mm the ends of its joints take {near_tip + near_hand + 3 * stem:.4g} mm",
            f"at least {k.MM * inst.overall_length + near_tip + near_hand + 3 * stem - stem_length:.4g} mm",
        )
    common = {"stem_length": stem_length, "stem_radius": stem, "stem_bore": bore, "tendon_radius": radius}
    rod_hand = max(rod for rod in (*_RODS, 10.0) if rod <= max(0.6 * big, _RODS[0]))
    return (
        End(
            True,
            key["distal_radius"],
            "yaw_carrier",
            far,
            **common,
            near_length=near_tip,
            far_collar=collar,
            rod=rods[-1],
            seat=seat,
            shift=shift,
        ),
        End(
            False,
            key["proximal_radius"],
            "handle_yaw_carrier",
            "handle_yaw_far",
            **common,
            near_length=near_hand,
            far_collar=max(hand.collar, 1.5 * rod_hand, 4 * sizes.wall + 2 * seat),
            rod=rod_hand,
            seat=seat,
            shift=shift,
        ),
    )


def _foot(joint: "GearJoint | PulleyJoint | Backbone", sizes: Sizes) -> float:
    """Return where the socket of a far body begins, from its axis, mm."""
    return (joint.collar if isinstance(joint, Backbone) else joint.depth) + sizes.wall


def _rig(
    inst: ShortForm, tip: End, joint: "GearJoint | PulleyJoint | Backbone", hand: "GearJoint | PulleyJoint"
) -> Rig:
    angles = np.linspace(-inst.output_range, inst.output_range, 41)
    frames = kinematics.frames(inst, Posture(yaw=angles, handle_yaw=0.0))
    places = k.MM * (frames.bodies["tip"].position - frames.bodies["stem"].position)
    straight = float(places[20, 2])
    pivot = straight - k.MM * inst.rig_arm
    distances = np.hypot(places[:, 0], places[:, 2] - pivot)
    half = tip.stem_radius if isinstance(joint, Backbone) else max(tip.stem_radius, joint.pin_length / 2)
    cable = inst.conditions.cable_pulley_radius or _CABLE_RADIUS
    return Rig(pivot, k.MM * cable, float(distances.min()), float(distances.max()), half + 3.0)
