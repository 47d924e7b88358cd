"""The state of the instrument at a glance, as HTML."""

from collections.abc import Iterable
from html import escape

from tenodesis.console.advice import ADVICE
from tenodesis.live.status import Status

class Advice(NamedTuple):
    """What is seen, and what helps."""

    seen: str
    do: str


ADVICE = {
    "tendon_break": Advice(
        "A tendon carries nothing, though its motor has wound it.",
        "Look whether it tore or came off its spool. Mend it, then home, then enable.",
    ),
    "tendon_slack": Advice(
        "A tendon has hung slack for long.",
        "Move the handle back or take the load off. If it stays slack, home: the pretension is lost.",
    ),
    "over_tension": Advice(
        "A tendon is pulled beyond the tension limit.",
        "Take the load off the tip and bring the handle toward straight, then clear.",
    ),
    "load_cell_stuck": Advice(
        "A load cell shows the same value again and again, without even noise.",
        "Check its cable and amplifier, then clear.",
    ),
    "load_cell_range": Advice(
        "A load cell shows what no tendon can cause.",
        "Check its cable and calibration, then clear.",
    ),
    "load_cell_drift": Advice(
        "The load cells do not fit what the motors have wound.",
        "Take the load off, let the cells warm up, set their zero again. Then home, then enable.",
    ),
    "encoder_dropout": Advice(
        "The handle's encoder shows an angle beyond the handle's range.",
        "Check its cable, then clear.",
    ),
    "encoder_jump": Advice(
        "The handle's encoder jumps faster than a hand can move.",
        "Check its cable and its coupling, then clear.",
    ),
    "spool_slip": Advice(
        "The tension fell at once, and no tendon broke: a spool slipped on its shaft.",
        "Tighten it. Then home, then enable.",
    ),
    "motor_not_following": Advice(
        "A spool does not turn as it is told.",
        "Look for what blocks it, and whether its drive has power. Then clear.",
    ),
    "tick_late": Advice(
        "The controller was not asked for too long, or measurements stand still.",
        "Close what keeps the machine busy, or look at the device's connection. Then clear.",
    ),
    "not_a_number": Advice(
        "A sensor gave something that is no number.",
        "Check the device's connection, then clear.",
    ),
    "homing_failed": Advice(
        "The pretension was not reached while homing.",
        "Look for a jammed or torn tendon and that the tip is free, then home again.",
    ),
}
"""By the fault's name in :data:`tenodesis.control.FAULTS`."""

_COLOURS = {"DISABLED": "#5b6675", "ENABLED": "#15703f", "PAUSED": "#8a5a00", "FAULT": "#b4232f", "GONE": "#b4232f"}
_WORDS = {
    "DISABLED": "The motors are off. Enable, and the controller moves them.",
    "ENABLED": "The controller moves the motors.",
    "PAUSED": "The motors stand. Resume to go on.",
    "FAULT": "The motors stand until the fault is cleared.",
    "GONE": "The motors are stopped by their own watchdogs.",
}


def status_line(status: Status, origin: str, notes: Iterable[str] = ()) -> str:
    """Return state, faults with advice, notes, and who operates, for the browser of an origin."""
    colour = _COLOURS.get(status.state, "#5b6675")
    words = "Homing: the motors look for the pretension." if status.homing else _WORDS.get(status.state, "")
    if status.stopped and status.state != "GONE":
        words = "Stopped: the motors are held until you go on."
    elif status.state in ("DISABLED", "PAUSED") and not status.homed and not status.homing:
        words = "Not homed: home first, the controller waits for that."
    lines = [
        '<div style="font-size:.8rem;line-height:1.35;color:#1b2733;padding:.3em .8em 0">',
        f'<span style="background:{colour};color:#fff;border-radius:4px;padding:.1em .5em;font-weight:600">'
        f"{escape(status.state)}</span> {words}",
        *(_fault(name, name in status.first_faults) for name in status.faults),
    ]
    lines += [_warning(sentence) for sentence in (status.problem, *_recorder(status), *notes) if sentence]
    if status.state != "GONE":
        lines.append(f"<div>{_operator(status, origin)}</div>")
    return "".join([*lines, "</div>"])


def timing_line(status: Status) -> str:
    """Return how the loop keeps time, as HTML."""
    timing = status.timing
    text = (
        f"{timing.rate:.0f} Hz, {timing.p50 * 1e6:.0f} µs a tick (99 %: {timing.p99 * 1e6:.0f} µs, worst: "
        f"{timing.worst * 1e6:.0f} µs); {timing.late} late, {timing.missed} missed of {timing.ticks} ticks"
    )
    notes = "".join(f"<div>{escape(sentence)}</div>" for sentence in status.realtime)
    return f'<div style="font-size:.75rem;line-height:1.35;color:#4a5563;padding:.2em .8em">{text}{notes}</div>'


def _fault(name: str, first: bool) -> str:
    advice = ADVICE.get(name)
    told = "" if advice is None else f" {escape(advice.seen)} <b>{escape(advice.do)}</b>"
    mark = " (came first)" if first else ""
    return (
        '<div style="border-left:4px solid #b4232f;background:#fdf0ef;padding:.3em .5em;margin:.3em 0">'
        f"<b>{escape(name)}</b>{mark}:{told}</div>"
    )


def _warning(sentence: str) -> str:
    return (
        '<div style="border-left:4px solid #8a5a00;background:#fdf6e7;padding:.3em .5em;margin:.3em 0">'
        f"{escape(sentence)}</div>"
    )


def _recorder(status: Status) -> list[str]:
    lost = status.recorder_lost
    return [f"The recorder has lost {lost} ticks: the recording has a gap."] if lost else []


def _operator(status: Status, origin: str) -> str:
    if status.operator == origin:
        return "You operate; others watch."
    if status.operator is None:
        return "Nobody operates. Take control to move something."
    return f"{escape(status.operator)} operates; you watch."


_NEXT: dict[str, tuple[tuple[str, Asked], ...]] = {
    "DISABLED": (("Enable", "enable"),),
    "ENABLED": (("Pause", "pause"), ("Disable", "disable")),
    "PAUSED": (("Resume", "resume"), ("Disable", "disable")),
    "FAULT": (("Clear the fault", "clear"),),
}
"""What can be asked next in each state."""


class StatusHeader:
    """State and the next steps."""

    def __init__(self, session: Session, inst: Instrument) -> None:
        self._session = session
        gui: Any = session.client.gui
        self._line = gui.add_html("")
        gui.add_html(f'<div style="padding:.35em .8em .2em">{TensionColours(inst).legend()}</div>')
        self._take = gui.add_button("Take control", color="blue", hint="From then on others watch.")
        self._restart = gui.add_button("Start the instrument again", color="orange", visible=False)
        self._buttons: dict[Asked, Any] = {
            what: gui.add_button(label, color=_colour(what), visible=False)
            for steps in _NEXT.values()
            for label, what in steps
        }
        session.on(self._take, "operator", self._acquire)
        session.on(self._restart, "restart", lambda: session.run_in_background("restart", session.link.restart))
        for what, button in self._buttons.items():
            session.on(button, "request", partial(session.link.request, what))

    def update(self, state: PageState) -> None:
        """Show state and the next steps."""
        status = state.status
        starting = self._session.is_busy("load", "restart")
        set_properties(self._line, content=status_line(status, self._session.origin, self._notes(starting=starting)))
        other = status.operator is not None and not state.operating
        set_properties(
            self._take,
            visible=not state.operating and status.state != "GONE",
            label="Take control from whoever operates" if other else "Take control",
        )
        set_properties(self._restart, visible=status.state == "GONE" and not starting)
        offered = {what for _, what in _NEXT.get(status.state, ())}
        for what, button in self._buttons.items():
            set_properties(button, visible=state.operating and what in offered)
        enable(self._buttons.values(), state.operating)

    def _notes(self, *, starting: bool) -> list[str]:
        notes = ["An instrument is being started."] if starting else []
        if self._session.replaying:
            notes.append("The view replays a recording; all else on this page is live.")
        return notes

    def _acquire(self) -> None:
        other = self._session.link.status().operator
        if not self._session.link.acquire(force=other is not None):
            self._session.notify("Somebody else operates now.", "You watch")


def _colour(what: str) -> Any:
    return {"enable": "green", "resume": "green", "clear": "orange"}.get(what, "gray")
