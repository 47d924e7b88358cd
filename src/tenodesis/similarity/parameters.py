"""Parameters of an instrument by the core's names, whatever its joint type calls them."""

from tenodesis import _core
from tenodesis.instrument import JOINT_TYPES, ShortForm

RADII = tuple(
    dict.fromkeys(
        field
        for kind in JOINT_TYPES.values()
        for parameter in ("distal_radius", "proximal_radius")
        for field, name in kind.parameter_fields.items()
        if name == parameter
    )
)
"""Fields of the distal and the proximal radius, for every joint type."""


def field_of(inst: ShortForm, parameter: str) -> str:
    """Return the field that sets a parameter of the core; raises KeyError if the joint type has no such parameter."""
    for field, name in inst.parameter_fields.items():
        if name == parameter:
            return field
    raise KeyError(parameter)


def value_of(inst: ShortForm, parameter: str) -> float:
    """Return a parameter of the core, in SI units."""
    return float(getattr(inst, field_of(inst, parameter)))


def tension_scale(inst: ShortForm) -> float:
    """Return k r, the tension that stretches a tendon by the distal radius, N (Table II)."""
    return _core.tension_scale(inst.spec)
