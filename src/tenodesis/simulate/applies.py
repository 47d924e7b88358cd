"""Which phases and keys an instrument has use for, by what it has: joints at the handle, pairs of tendons, jaws."""

from tenodesis.errors import ProtocolError
from tenodesis.run import TENDONS
from tenodesis.simulate.phases import Phase
from tenodesis.simulate.places import Place, Places

_OF_FORCE = {
    "force": "wrench",
    "usual_force": "wrench",
    "force_end": "wrench of a ramp",
    "radial_force": "wrench",
    "weight": "wrench",
    "moment": "wrench",
    "load_steps": "wrench of a step-load",
    "force_amplitude": "amplitude",
}
"""Keys about a force against flexion, and what to give where there is none."""


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
    if at.load is None:
        moved = f"{at.name} of {inst.name}"
        why = f"but {moved} moves no joint at the tip"
        if at.bends:
            why = f"but no force across the straight tip turns what {moved} moves"
        if kind == "contact":
            raise _wrong_kind(kind, why, "object" if inst.grip is not None else "step-load with a wrench")
        wrong = {key: (instead, why) for key, instead in _OF_FORCE.items()}
        if not at.bends:
            wrong |= {"output_angle": ("handle_angle", why), "output_amplitude": ("amplitude", why)}
    if len(at.tendons) != len(TENDONS):
        why = f"but {at.name} of {inst.name} moves no joint with a pair of tendons of its own"
        wrong["spool_velocity"] = "spool_velocities", why
    if inst.grip is None:
        if kind == "object" and at.load is None:
            raise ProtocolError(f"kind is object, {jawless}; its file must have a table [grip]", key="kind", value=kind)
        if kind == "object":
            raise _wrong_kind(kind, jawless, "contact")
        wrong["grip_force"] = "wrench" if at.load is None else "force", jawless
    for key, (instead, why) in wrong.items():
        value = getattr(phase, key, None)
        if key in phase.model_fields_set and value not in (None, (), False):
            raise ProtocolError(f"{key} is given, {why}; give {instead}", key=key, value=value, allowed=instead)
    return at


def _wrong_kind(kind: str, why: str, instead: str) -> ProtocolError:
    return ProtocolError(f"kind is {kind}, {why}; it must be {instead}", key="kind", value=kind, allowed=instead)
