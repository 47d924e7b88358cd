"""Default tolerances: a workshop's general tolerances, and typical errors of an identification."""

from collections.abc import Iterator
from math import inf
from typing import Any

from tenodesis.instrument import FullForm, Instrument, InstrumentLike, ShortForm
from tenodesis.instrument.reading import as_instrument
from tenodesis.similarity.parameters import RADII
from tenodesis.tolerance.files import Tolerance, Tolerances

# By class: largest dimension (m) and its half width (mm); the last is that of 1 to 2 m.
_GENERAL: dict[str, tuple[tuple[float, float], ...]] = {
    "f": ((6e-3, 0.05), (30e-3, 0.1), (120e-3, 0.15), (400e-3, 0.2), (1.0, 0.3), (inf, 0.5)),
    "m": ((6e-3, 0.1), (30e-3, 0.2), (120e-3, 0.3), (400e-3, 0.5), (1.0, 0.8), (inf, 1.2)),
    "c": ((3e-3, 0.2), (6e-3, 0.3), (30e-3, 0.5), (120e-3, 0.8), (400e-3, 1.2), (1.0, 2.0), (inf, 3.0)),
}

_LENGTHS = ("overall_length", "end_effector_length", "handle_length", "backbone_length")
_STIFFNESS = "ours: a pull test of rope and terminations"
_IDENTIFIED = "ours: several coefficients fit one bench's readings alike, see the comments of scaled-up.toml"
_IDENTIFICATION: dict[str, dict[str, Any]] = {
    "tendon_modulus": {"distribution": "normal", "standard_deviation": "5 %", "source": _STIFFNESS},
    "tendon_stiffness": {"distribution": "normal", "standard_deviation": "5 %", "source": _STIFFNESS},
    "backbone_rigidity": {"distribution": "normal", "standard_deviation": "5 %", "source": "ours: a bending test"},
    "pretension": {
        "distribution": "normal",
        "standard_deviation": "5 %",
        "source": "ours: set by load cells beside the spools, with the sheath's friction between them and the joints",
    },
    **{
        f"friction.{key}": {"distribution": "normal", "standard_deviation": "20 %", "source": _IDENTIFIED}
        for key in ("vertex_coefficient", "sheath_coefficient")
    },
    "friction.sheath_bend": {
        "distribution": "uniform",
        "half_width": "50 %",
        "source": "ours: how the hand leads the sheath",
    },
}


def default(scaled_up: InstrumentLike) -> Tolerances:
    """Return the default tolerances of a scaled-up instrument.

    Radii have ISO 2768-1 class f and lengths class m, as half widths by their size; stiffness, pretension and friction
    have what we assume as the error of an identification; joints and tendons that are listed have each their own. Keys
    that the instrument lacks, or has as zero, are left out.
    """
    inst = as_instrument(scaled_up, "scaled_up")
    found = [] if isinstance(inst, ShortForm) else [*_of_joints(inst.expanded), *_of_tendons(inst.expanded)]
    for keys, grade in ((RADII, "f"), (_LENGTHS, "m")):
        for key in keys:
            if isinstance(inst, ShortForm) and getattr(inst, key, None):
                found.append(_machined(key, getattr(inst, key), grade))
    for key, values in _IDENTIFICATION.items():
        if (isinstance(inst, ShortForm) or key.startswith("friction.")) and _given(inst, key):
            found.append(Tolerance(key=key, **values))
    return Tolerances(
        name="defaults",
        description="ISO 2768-1 for radii (f) and lengths (m); ours for what is identified",
        parameters=tuple(found),
    )


def _of_joints(inst: FullForm) -> Iterator[Tolerance]:
    for joint in inst.as_given("joints"):
        own = f"joints.{joint.name}"
        yield _machined(f"{own}.radius", joint.radius, "f")
        for key in ("end_effector_length", "backbone_length"):
            if getattr(joint, key):
                yield _machined(f"{own}.{key}", getattr(joint, key), "m")
        for key in ("backbone_rigidity", "stiffness"):
            if getattr(joint, key):
                yield Tolerance(key=f"{own}.{key}", **_IDENTIFICATION["backbone_rigidity"])


def _of_tendons(inst: FullForm) -> Iterator[Tolerance]:
    for tendon, tension in zip(inst.as_given("tendons"), inst.pretensions, strict=True):
        own = f"tendons.{tendon.name}"
        for crossing in tendon.route:
            # What is smaller than its tolerance is the rounding of none.
            if (crossing.radius or 0.0) > 1e-3 * general_tolerance(crossing.radius or 0.0, "f"):
                yield _machined(f"{own}.{crossing.joint}.radius", crossing.radius or 0.0, "f")
        if tendon.stiffness_by_tension is None:
            yield Tolerance(key=f"{own}.stiffness", **_IDENTIFICATION["tendon_stiffness"])
        if tension:
            yield Tolerance(key=f"{own}.pretension", **_IDENTIFICATION["pretension"])


def general_tolerance(size: float, grade: str) -> float:
    """Return the half width (mm) of a length (m) by ISO 2768-1, class f, m or c."""
    return next(width for limit, width in _GENERAL[grade] if size <= limit)


def _machined(key: str, size: float, grade: str) -> Tolerance:
    half_width = general_tolerance(size, grade)
    return Tolerance(
        key=key, distribution="uniform", half_width=f"{half_width} mm", source=f"ISO 2768-1, class {grade}"
    )


def _given(inst: Instrument, key: str) -> bool:
    if key == "tendon_stiffness":
        return inst.given_stiffness is not None
    if key == "tendon_modulus":
        return inst.given_stiffness is None
    table, _, inner = key.partition(".")
    held = getattr(inst, table, None)
    return bool(getattr(held, inner) if inner else held)
