"""What a fault means in plain words, and what to do about it."""

from typing import NamedTuple


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
