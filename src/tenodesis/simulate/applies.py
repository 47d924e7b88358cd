"""Which phases and keys an instrument has use for, by what it has: joints at the handle, pairs of tendons, jaws."""

from tenodesis.errors import ProtocolError
from tenodesis.simulate.phases import Phase
from tenodesis.simulate.places import Place, Places

_OF_PAIR = {
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
"""Keys about a joint with a pair of tendons of its own, and what to give without one."""


def applied_to(phase: Phase, places: Places) -> Place:
    """Return what a phase acts on.

    Raises
    ------
    ProtocolError
        The instrument does not have it, or lacks what a phase of this kind, or a key of it, needs.
    """
    inst, kind = places.inst, str(getattr(phase, "kind", ""))
    if kind == "pretension" and not places.wound:
        raise _wrong_kind(kind, f"but no tendon of {inst.name} has a spool", "hold")
    at, jawless = phase.place(places), f"but {inst.name} has no jaws that grip"
    wrong: dict[str, tuple[str, str]] = {}
    if at.plane is None:
        moved = f"no joint at the tip of {inst.name} has a handle joint and"
        if at.joint is not None:
            moved = f"{at.joint.name} of {inst.name} moves no joint with"
        why = f"but {moved} a pair of tendons of its own"
        if kind == "contact":
            raise _wrong_kind(kind, why, "object" if inst.grip is not None else "step-load with a wrench")
        wrong = {key: (instead, why) for key, instead in _OF_PAIR.items()}
        if inst.handle_joints:
            handle, where = ("handle_angles", "handle_angles") if kind == "ramp" else ("", "handle_angle")
        else:
            handle = where = "spool_velocities of a ramp, or spool_tensions"
            why = f"but {inst.name} has no joint at the handle"
        wrong["output_angle"] = where, why
        if handle:
            wrong["handle_angle"] = handle, why
    if inst.grip is None:
        if kind == "object" and at.plane is None:
            raise ProtocolError(f"kind is object, {jawless}; its file must have a table [grip]", key="kind", value=kind)
        if kind == "object":
            raise _wrong_kind(kind, jawless, "contact")
        wrong["grip_force"] = "wrench" if at.plane is None else "force", jawless
    for key, (instead, why) in wrong.items():
        value = getattr(phase, key, None)
        if key in phase.model_fields_set and value not in (None, ()):
            raise ProtocolError(f"{key} is given, {why}; give {instead}", key=key, value=value, allowed=instead)
    return at


def _wrong_kind(kind: str, why: str, instead: str) -> ProtocolError:
    return ProtocolError(f"kind is {kind}, {why}; it must be {instead}", key="kind", value=kind, allowed=instead)
