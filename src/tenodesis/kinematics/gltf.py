"""What the glTF file of an assembly says of its instrument: for those that write and those that read it."""

from tenodesis.instrument import Continuum, InstrumentLike, as_short_form
from tenodesis.kinematics.dimensions import dimensions

BODY_NODE = "body "
"""Begin of the name of the node of a body; the body's name in :func:`tenodesis.kinematics.frames` follows."""


def described(inst: InstrumentLike) -> dict[str, str | float]:
    """Return what solids must have in common with an instrument to be its own: joint type and lengths (m) of its axis.

    Raises as :func:`tenodesis.kinematics.dimensions` does.
    """
    inst = as_short_form(inst)
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
