"""Which phases and keys an instrument has use for, by what it has: pairs of tendons, joints at the handle, jaws."""

from collections.abc import Mapping

from tenodesis.errors import ProtocolError
from tenodesis.simulate.phases import Phase
from tenodesis.simulate.places import Places

_PAIRED: Mapping[str, str] = {
    "axis": "joint",
    "force": "wrench",
    "force_end": "wrench of a ramp",
    "radial_force": "wrench",
    "weight": "wrench",
    "moment": "wrench",
    "load_steps": "wrench of a step-load",
    "force_amplitude": "amplitude",
    "output_amplitude": "amplitude",
    "output_angle": "handle_angle",
    "spool_velocity": "spool_velocities",
}
"""Keys about an axis, which needs a pair of tendons, and what to give without one."""


def check_applies(phase: Phase, places: Places) -> None:
    """Refuse a phase of a kind, or with a key, for which an instrument lacks what it acts on, by ProtocolError."""
    inst = places.inst
    unpaired = f"which takes a pair of tendons for every joint of the tip, and {inst.name} has none of its own for "
    unpaired += " and ".join(places.unpaired)
    jawless = f"but {inst.name} has no jaws that grip"
    kind = str(getattr(phase, "kind", ""))
    if kind in ("pretension", "contact") and places.unpaired:
        touching = "object" if inst.grip is not None else "step-load with a wrench"
        instead = touching if kind == "contact" else "hold; its tendons are at their pretension at the start"
        raise _wrong_kind(kind, unpaired, instead)
    if kind == "object" and inst.grip is None:
        if places.unpaired:
            raise ProtocolError(f"kind is object, {jawless}; its file must have a table [grip]", key="kind", value=kind)
        raise _wrong_kind(kind, jawless, "contact")
    wrong = {}
    if places.unpaired:
        wrong = _PAIRED | ({"handle_angle": "handle_angles"} if kind == "ramp" else {})
    if inst.grip is None:
        wrong |= {"grip_force": "wrench" if places.unpaired else "force"}
    for key, instead in wrong.items():
        value = getattr(phase, key, None)
        if key in phase.model_fields_set and value not in (None, ()):
            why = jawless if key == "grip_force" else unpaired
            raise ProtocolError(f"{key} is given, {why}; give {instead}", key=key, value=value, allowed=instead)


def _wrong_kind(kind: str, why: str, instead: str) -> ProtocolError:
    return ProtocolError(f"kind is {kind}, {why}; it must be {instead}", key="kind", value=kind, allowed=instead)
