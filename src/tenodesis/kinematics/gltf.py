"""What the glTF file of an assembly says of its instrument: for those that write and those that read it."""

from tenodesis.instrument import Continuum, InstrumentLike, as_instrument
from tenodesis.kinematics.dimensions import dimensions

BODY_NODE = "body "
"""Begin of the name of the node of a body; the body's name in :func:`tenodesis.kinematics.frames` follows."""


def described(inst: InstrumentLike) -> dict[str, str | float]:
    """Return what solids must have in common with an instrument to be its own: joint type and lengths (m) of its axis.

    Of joints and tendons it is the mechanism, radius and offset of every joint. Raises as
    :func:`tenodesis.kinematics.dimensions` does.
    """
    given = as_instrument(inst)
    if given.short_form is None:
        full = given.expanded
        found: dict[str, str | float] = {f"{one.name}.mechanism": one.mechanism for one in full.joints}
        for key in ("radius", "offset"):
            found |= {f"{one.name}.{key}": getattr(one, key) for one in full.joints}
        return found | {"stem_length": full.stem_length or 0.0}
    inst = given.short_form
    lengths = dimensions(inst)
    return {
        "joint_type": inst.joint_type,
        "end_effector_length": lengths.end_effector_length,
        "handle_length": lengths.handle_length,
        "distal_radius": lengths.distal_radii[0],
        "proximal_radius": lengths.proximal_radii[0],
        **({"backbone_length": inst.backbone_length} if isinstance(inst, Continuum) else {}),
        # It follows from the others in a file.
        "stem_length": lengths.stem_length,
    }
