"""Which phases and keys an instrument has use for, by what it has: pairs of tendons, joints at the handle, jaws."""

from tenodesis.errors import ProtocolError
from tenodesis.simulate.phases import Phase
from tenodesis.simulate.places import Places

_PAIRED = {
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
    inst, kind = places.inst, str(getattr(phase, "kind", ""))
    jawless = f"but {inst.name} has no jaws that grip"
    wrong = {"wrench": ("force and radial_force", f"but {inst.name} takes forces by axis")}
    if places.unpaired:
        why = f"but {places.unpaired[0]} of {inst.name} has no handle joint and pair of tendons of its own"
        if kind == "pretension":
            raise _wrong_kind(kind, why, "hold; its tendons are at their pretension at the start")
        if kind == "contact":
            raise _wrong_kind(kind, why, "object" if inst.grip is not None else "step-load with a wrench")
        wrong = {key: (instead, why) for key, instead in _PAIRED.items()}
        if kind == "ramp":
            wrong["handle_angle"] = "handle_angles", why
    if inst.grip is None:
        if kind == "object" and places.unpaired:
            raise ProtocolError(f"kind is object, {jawless}; its file must have a table [grip]", key="kind", value=kind)
        if kind == "object":
            raise _wrong_kind(kind, jawless, "contact")
        wrong["grip_force"] = "wrench" if places.unpaired else "force", jawless
    for key, (instead, why) in wrong.items():
        value = getattr(phase, key, None)
        if key in phase.model_fields_set and value not in (None, ()):
            raise ProtocolError(f"{key} is given, {why}; give {instead}", key=key, value=value, allowed=instead)


def _wrong_kind(kind: str, why: str, instead: str) -> ProtocolError:
    return ProtocolError(f"kind is {kind}, {why}; it must be {instead}", key="kind", value=kind, allowed=instead)
