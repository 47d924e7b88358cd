"""The top of the panel: state, faults with advice, who operates, and the buttons that the state allows."""

import math
from collections.abc import Iterable, Mapping
from functools import partial
from html import escape
from typing import Any, NamedTuple

from tenodesis.console.plots import TensionColours
from tenodesis.console.session import PageState, Session, enable, set_properties
from tenodesis.control import HOMING_REASONS
from tenodesis.instrument import Instrument
from tenodesis.live.commands import ControllerRequest
from tenodesis.live.status import RuntimeState, Status


class Advice(NamedTuple):
    """What a fault means, and what to do about it."""

    meaning: str
    remedy: str


ADVICE = {
    "tendon_break": Advice(
        "A tendon has no tension, although its motor has wound it.",
        "Check whether it broke or came off its spool. Repair it, then home, then enable.",
    ),
    "tendon_slack": Advice(
        "A tendon has been slack for too long.",
        "Move the handle back or take the load off. If it stays slack, home: the pretension is lost.",
    ),
    "over_tension": Advice(
        "A tendon tension is above the tension limit.",
        "Take the load off the tip and bring the handle toward straight, then clear.",
    ),
    "load_cell_stuck": Advice(
        "A load cell repeats exactly the same value, without noise.", "Check its cable and amplifier, then clear."
    ),
    "load_cell_range": Advice(
        "A load cell shows a tension that no tendon can have.", "Check its cable and calibration, then clear."
    ),
    "load_cell_drift": Advice(
        "The load cells do not agree with the length that the motors have wound, or were exchanged.",
        "Check their cables, take the load off, let the cells warm up, set their zero again. Then home, then enable.",
    ),
    "encoder_dropout": Advice(
        "The handle's encoder shows an angle beyond the handle's range.", "Check its cable, then clear."
    ),
    "encoder_jump": Advice(
        "The encoder of the handle or of a spool jumps faster than either can turn.",
        "Check its cable and its coupling, then clear, and home.",
    ),
    "spool_slip": Advice(
        "The tension dropped suddenly and no tendon broke: a spool slipped on its shaft.",
        "Tighten it. Then home, then enable.",
    ),
    "motor_not_following": Advice(
        "A spool does not turn as commanded, or its encoder loses counts.",
        "Check whether something blocks it, its drive's power and its encoder's cable, then clear, and home.",
    ),
    "tick_late": Advice(
        "The controller got no tick for too long, or the measurements are not updated.",
        "Close programs that load the machine, or check the device's connection, then clear.",
    ),
    "not_a_number": Advice("A measurement is not a number.", "Check the device's connection, then clear."),
    "homing_failed": Advice(
        "Homing has found something wrong and stopped.", "Put it right as said below, clear, then home again."
    ),
    "stroke_unexplained": Advice(
        "The motors have moved the tip further than any load explains: a sensor, a rope or a motor is not as it seems.",
        "Check the spools' encoders, the load cells and the ropes. Then home, then enable.",
    ),
    "rope_length": Advice(
        "A rope has got longer or shorter since homing, or a tension is read wrongly: the tip may be off.",
        "Check knots, crimps, the ropes on their spools and the zeros of the tensions. Then home, then enable.",
    ),
}
"""By the names in :data:`tenodesis.control.FAULTS`, of an instrument with load cells."""

CURRENT_ADVICE = {
    "load_cell_stuck": Advice(
        "A motor's current repeats exactly the same value, without noise.",
        "Check the connection of its drive, then clear.",
    ),
    "load_cell_range": Advice(
        "A motor's current is at the end of its range, or stands for a tension that no tendon can have.",
        "Check the drive's limit of current and the torque constant in the file, then clear.",
    ),
    "load_cell_drift": Advice(
        "The motors' currents do not agree with the length that the motors have wound, or were exchanged.",
        "Take the load off, let the motors warm up, check torque constant and friction of the drives. Then home, then "
        "enable.",
    ),
    "stroke_unexplained": Advice(
        ADVICE["stroke_unexplained"].meaning,
        "Check the spools' encoders, the motors' currents and the ropes. Then home, then enable.",
    ),
}
"""Where currents measure the tensions, in the place of these."""

HOMING_REMEDIES = {
    "tip_loaded": "Take everything off the tip. If it is free, set the zero of the load cells again.",
    "cell_offset": "Set the load cell's zero with a slack tendon; check its cable.",
    "cell_reversed": "Exchange the wires of the load cell's signal.",
    "cells_swapped": "Check which load cell, and which motor with its encoder, belongs to which tendon.",
    "cell_gains_apart": "Calibrate both load cells; see whether one tendon rubs.",
    "motor_dead": "Check the power and the cables of the motor and of its encoder.",
    "motor_reversed": "Reverse the motor or its encoder; homing from tight tendons shows which.",
    "motors_swapped": "Exchange the motors' cables, or those of their encoders.",
    "encoder_reversed": "Reverse the encoder's direction.",
    "encoders_swapped": "Exchange the cables of the spool encoders.",
    "encoder_gain": "Check the encoder's counts per turn and the gear ratio.",
    "spool_reversed": "Reverse both the motor and its encoder, or wind the tendon onto its spool the other way.",
    "tendon_broken": "Check whether the tendon broke or came off its spool, and bring the tip in line with the handle.",
    "tendons_slack": "Wind both tendons by hand until they are nearly tight; check that both motors wind.",
    "tendon_jammed": "Free the tendons.",
    "stiffness_wrong": "Check the calibration of the load cells and the stiffness in the instrument file.",
    "handle_moved": "Hold the handle still.",
    "timed_out": "Look at the tensions while homing: they do not settle.",
    "too_coarse": "Take load cells, or a smaller range of the currents; or begin at the pretension, homed by hand.",
}
"""What to do, by the names in :data:`tenodesis.control.HOMING_REASONS`, of an instrument with load cells."""

CURRENT_REMEDIES = {
    "tip_loaded": "Take everything off the tip. If it is free, check the currents' zeros and the drives' friction.",
    "cell_offset": "Check the zero of the drive's current, and the drives' friction in the file.",
    "cell_reversed": "Reverse the sign of the drive's current.",
    "cells_swapped": "Check which drive, with its current and its encoder, belongs to which tendon.",
    "cell_gains_apart": "Check the torque constants of both motors; see whether one tendon or one gearbox rubs.",
    "stiffness_wrong": "Check torque constant, friction of the drives and stiffness in the instrument file.",
}
"""Where currents measure the tensions, in the place of these."""

_COLOURS = {
    RuntimeState.DISABLED: "#5b6675",
    RuntimeState.ENABLED: "#15703f",
    RuntimeState.PAUSED: "#8a5a00",
    RuntimeState.FAULT: "#b4232f",
    RuntimeState.GONE: "#b4232f",
}
_MEANING = {
    RuntimeState.DISABLED: "The motors are off. Enable to let them move.",
    RuntimeState.ENABLED: "The controller moves the motors.",
    RuntimeState.PAUSED: "The motors are stopped. Resume to go on.",
    RuntimeState.FAULT: "The motors are stopped until the fault is cleared.",
    RuntimeState.GONE: "The motors are stopped by their own watchdogs.",
}


_RELEASED_BY = {
    RuntimeState.DISABLED: "Enable takes it back.",
    RuntimeState.PAUSED: "Resume takes it back.",
    RuntimeState.FAULT: "Clear the fault, then enable, takes it back; where its zero is unknown, home first.",
}
"""By which button a stroke is released, by the states in which the motors do not work."""
_NOTICED = math.radians(0.5)


def status_line(status: Status, origin: str, notes: Iterable[str] = (), *, currents: bool = False) -> str:
    """Return as HTML state, faults with advice, notes, and who operates, for the browser of an origin.

    currents: whether currents measure the tensions, in the place of load cells.
    """
    advice = ADVICE | CURRENT_ADVICE if currents else ADVICE
    remedies = HOMING_REMEDIES | CURRENT_REMEDIES if currents else HOMING_REMEDIES
    words = "Homing: the motors wind the tendons to the pretension." if status.homing else _MEANING[status.state]
    if status.stopped and status.state != RuntimeState.GONE:
        words = "Stopped. STOP once more holds the motors where they are; resume to go on."
    elif status.state in (RuntimeState.DISABLED, RuntimeState.PAUSED) and not status.homed and not status.homing:
        words = "Not homed: the zero of the spools is unknown, home first."
    lines = [
        '<div style="font-size:.8rem;line-height:1.35;color:#1b2733;padding:.3em .8em 0">',
        f'<span style="background:{_COLOURS[status.state]};color:#fff;border-radius:4px;padding:.1em .5em;'
        'font-weight:600">'
        f"{escape(status.state)}</span> {words}",
        *(_fault(name, advice.get(name), name in status.first_faults) for name in status.faults),
        *(_homing_failure(axis, failed, remedies) for axis, failed in status.homing_failures.items() if status.faults),
    ]
    if status.state in _RELEASED_BY:
        lines += [_wound(axis, angle, _RELEASED_BY[status.state]) for axis, angle in status.wound.items()]
    lines += [_warning(sentence) for sentence in (status.problem, *_recorder(status), *notes) if sentence]
    if status.state != RuntimeState.GONE:
        lines.append(f"<div>{_operator(status, origin)}</div>")
    return "".join([*lines, "</div>"])


def timing_line(status: Status) -> str:
    """Return as HTML the loop's rate and the compute time of its ticks."""
    timing = status.timing
    text = (
        f"{timing.rate:.0f} Hz, {timing.p50 * 1e6:.0f} µs per tick (99 %: {timing.p99 * 1e6:.0f} µs, worst: "
        f"{timing.worst * 1e6:.0f} µs); {timing.late} late and {timing.missed} missed of {timing.ticks} ticks"
    )
    notes = "".join(f"<div>{escape(sentence)}</div>" for sentence in status.realtime)
    return f'<div style="font-size:.75rem;line-height:1.35;color:#4a5563;padding:.2em .8em">{text}{notes}</div>'


def _fault(name: str, advice: Advice | None, first: bool) -> str:
    text = "" if advice is None else f" {escape(advice.meaning)} <b>{escape(advice.remedy)}</b>"
    mark = " (first)" if first else ""
    return (
        '<div style="border-left:4px solid #b4232f;background:#fdf0ef;padding:.3em .5em;margin:.3em 0">'
        f"<b>{escape(name)}</b>{mark}:{text}</div>"
    )


def _homing_failure(axis: str, failure: str, remedies: Mapping[str, str]) -> str:
    reason, _, tendon = failure.partition(".")
    place = f"{axis}, {tendon}" if tendon else axis
    meaning, remedy = HOMING_REASONS.get(reason, ""), remedies.get(reason, "")
    return _warning(f"{place}: {meaning} ({reason}). {remedy}")


def _wound(axis: str, angle: float, released_by: str) -> str:
    """Return what is worth knowing of motors that are stopped while wound; nothing of less than half a degree."""
    if abs(angle) < _NOTICED:
        return ""
    held = f"{axis}: the motors hold the tip {math.degrees(angle):+.1f}° from where it hangs without them"
    return _warning(f"{held}; they return there by themselves unless the file says hold. {released_by}")


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
        return "There is no operator. Take control to move something."
    return f"{escape(status.operator)} operates; you watch."


_TRANSITIONS: dict[RuntimeState, tuple[tuple[str, ControllerRequest], ...]] = {
    RuntimeState.DISABLED: (("Enable", "enable"),),
    RuntimeState.ENABLED: (("Pause", "pause"), ("Disable", "disable")),
    RuntimeState.PAUSED: (("Resume", "resume"), ("Disable", "disable")),
    RuntimeState.FAULT: (("Clear the fault", "clear"),),
}
"""Buttons of each state, with what they request."""
_BUTTON_COLOURS = {"enable": "green", "resume": "green", "clear": "orange"}


class StatusHeader:
    """The state, the scale of the tendons' colours, and the buttons that the state allows."""

    def __init__(self, session: Session, inst: Instrument) -> None:
        self._session = session
        self._currents = inst.sensors.kind == "current"
        gui: Any = session.client.gui
        self._line = gui.add_html("")
        gui.add_html(f'<div style="padding:.35em .8em .2em">{TensionColours(inst).legend()}</div>')
        self._take = gui.add_button("Take control", color="blue", hint="Other browsers then only watch.")
        self._restart = gui.add_button("Start the instrument again", color="orange", visible=False)
        self._buttons: dict[ControllerRequest, Any] = {
            request: gui.add_button(label, color=_BUTTON_COLOURS.get(request, "gray"), visible=False)
            for buttons in _TRANSITIONS.values()
            for label, request in buttons
        }
        session.on(self._take, "operator", self._acquire)
        session.on(self._restart, "restart", lambda: session.run_in_background("restart", session.link.restart))
        for request, button in self._buttons.items():
            session.on(button, "request", partial(session.link.request, request))

    def update(self, state: PageState) -> None:
        """Show the state and its buttons."""
        status = state.status
        starting = self._session.is_busy("load", "restart")
        notes = self._notes(starting=starting)
        set_properties(self._line, content=status_line(status, self._session.origin, notes, currents=self._currents))
        other = status.operator is not None and not state.operating
        set_properties(
            self._take,
            visible=not state.operating and status.state != RuntimeState.GONE,
            label="Take control from the operator" if other else "Take control",
        )
        set_properties(self._restart, visible=status.state == RuntimeState.GONE and not starting)
        offered = {request for _, request in _TRANSITIONS.get(status.state, ())}
        for request, button in self._buttons.items():
            set_properties(button, visible=state.operating and request in offered)
        enable(self._buttons.values(), state.operating)

    def _notes(self, *, starting: bool) -> list[str]:
        notes = ["An instrument is starting."] if starting else []
        if self._session.replaying:
            notes.append("The view replays a recording; all else on this page is live.")
        return notes

    def _acquire(self) -> None:
        other = self._session.link.status().operator
        if not self._session.link.acquire(force=other is not None):
            self._session.notify("Another browser has just taken control.", "You watch")
