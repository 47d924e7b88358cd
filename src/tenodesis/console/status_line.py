"""The state of the instrument at a glance, as HTML."""

from collections.abc import Iterable
from html import escape

from tenodesis.console.advice import ADVICE
from tenodesis.live.status import Status

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
