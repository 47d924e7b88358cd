"""Bodies that two gear pairs have in common, one standing on the other."""

from tenodesis.cad import kernel as k
from tenodesis.cad.gears import (
    GearJoint,
    bores,
    end_dimension,
    far_half,
    gear_notes,
    half_dimensions,
    toothed_half,
)
from tenodesis.cad.parts import Dimension, End, Part, Sizes, refuse


def outer_place(inner: End, outer: End) -> k.Location:
    """Return where a near half is in the frame of the far half that it stands on, whose z is toward its own mate."""
    return inner.place(far=True).inverse() * outer.place(outer.start)


def check_between(inner: GearJoint, outer: GearJoint, outer_end: End, sizes: Sizes) -> None:
    """Refuse axes so near to each other that there is no room for the ends of the tendons between their links."""
    apart = abs(outer_end.start)
    collar, least = apart - inner.depth - outer.depth, 2 * sizes.rope + 2 * sizes.wall
    if collar < least:
        refuse(
            outer_end.key_of("offset"),
            apart,
            f"the links of both joints leave {max(collar, 0.0):.3g} mm between them for the ends of the tendons",
            f"at least {apart - collar + least:.4g} mm for process {sizes.process.name}",
        )


def between_part(inner: GearJoint, inner_end: End, outer: GearJoint, outer_end: End, sizes: Sizes) -> Part:
    """Return the far half of a joint with the near half of the next."""
    apart = abs(outer_end.start)
    collar = apart - inner.depth - outer.depth
    body, bottom = far_half(inner, inner_end, sizes, collar)
    place = outer_place(inner_end, outer_end)
    half = toothed_half(
        outer._replace(collar=min(outer.collar, collar)), sizes, outer_end.passing_in(), tooth_ahead=True
    )
    # About its tunnels through the collar, at the handle wider than the block.
    radius = outer.gear.pitch_radius
    wide = radius + outer.tunnel / 2 + sizes.wall
    half += k.box((-wide, wide), (-outer.middle, outer.middle), (-outer.depth - collar, -outer.depth))
    body += place * half
    for bore in bores(outer, apart, outer_end.passing_in()):
        body -= place * bore
    of = f"{inner_end.prefix} and {outer_end.prefix}".replace("_", " ")
    return Part(
        f"{inner_end.prefix}_{outer_end.prefix}",
        f"Gears of {of}",
        body,
        inner_end.far,
        (inner_end.place(far=True),),
        dimensions=(
            *half_dimensions(inner, inner_end),
            Dimension.height("axis to axis", 0, -apart, -1, key=outer_end.key_of("offset")),
            Dimension(
                "other tunnels apart", (0, -radius, -apart), (0, radius, -apart), "side", -1, "", outer_end.key, 2
            ),
            end_dimension(inner, inner_end, sizes, bottom),
        ),
        notes=(*gear_notes(inner), f"The other gear, {apart:.4g} mm on: {gear_notes(outer)[0].removeprefix('Gear: ')}"),
        away=(0, 0, inner_end.outward * 2.5 * inner.gear.pitch_radius * (2 * inner_end.order + 1)),
    )
