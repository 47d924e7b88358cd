"""Candidates for a protocol, and the unplanned protocols of equal duration to compare with.

A candidate is a block of phases that begins and ends straight and unloaded, with the spools where they were.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple, TypeAlias

from tenodesis import statics
from tenodesis.errors import IdentificationError, NoSolutionError
from tenodesis.instrument import ShortForm
from tenodesis.simulate import Cycles, Hold, Ramp, StepLoad
from tenodesis.simulate.protocol import AnyPhase

Phase: TypeAlias = AnyPhase

AMPLITUDES = (0.3, 0.6, 1.0)
"""Handle amplitudes, as shares of the largest."""
SPEEDS = {"slow": math.radians(20), "fast": math.radians(60)}
"""Handle speeds, rad/s."""
LOADS = (0.2, 0.4, 0.8, 1.2)
"""Forces at the tip, as shares of that at which the straight tip's antagonist goes slack."""
STROKE = 0.5
"""Change of tension by a stroke of the spools, over the pretension."""
SLACKENING = 1.3
"""The same for a stroke that lets tendons hang slack."""

_LOADING = 0.3
_DWELL = 0.3
"""After a stroke, in which the drives come to rest."""
_STROKE_TIME = 0.5
_SPEEDING = 0.1
_RISE = 0.1
_STEP_TIME = 0.6
_REVERSAL_TIME = 1.0
_MOST_SPEED = 0.5
"""Share of the drives' speed limit."""
_PAPER_LOADING, _PAPER_RESTING = 0.5, 0.25
_PAPER_CYCLES = 2
_PLAIN_PERIOD = 6.6
"""Of the plain cycles, s: those of the paper's Fig. 14 at 10 deg/s on its scaled-up instrument."""


class Candidate(NamedTuple):
    """A block of phases, or a motion of several joints, with its name."""

    name: str
    kind: str
    phases: tuple[Any, ...]


def loads(inst: ShortForm, forces: Sequence[float] | None = None) -> tuple[float, ...]:
    """Return the forces at the tip (N), ascending: those given, or shares of the force at slack onset.

    Raises IdentificationError if a force is not a finite number above 0.
    """
    if forces is not None:
        for force in forces:
            if not 0 < force < math.inf:
                raise IdentificationError(key="forces", value=force, allowed="above 0 N")
        return tuple(sorted(set(forces)))
    try:
        limit = float(statics.slack_force(inst, 0.0))
    except NoSolutionError:
        return ()
    return tuple(float(f"{share * limit:.2g}") for share in LOADS)


def candidates(inst: ShortForm, forces: Sequence[float]) -> list[Candidate]:
    """Return all candidates for a one-axis instrument under the forces (N) of its bench."""
    reach = math.radians(math.floor(math.degrees(statics.reach(inst)) * 10) / 10)
    return [
        *_cycles(reach, forces),
        *_step_loads(reach, forces),
        *_reversals(reach, forces),
        *_strokes(inst, reach, forces),
        *_levels(inst, reach, forces),
    ]


def baselines(inst: ShortForm, forces: Sequence[float], duration: float) -> dict[str, tuple[Phase, ...]]:
    """Return protocols of a one-axis instrument by name: plain cycles without load, and the paper's cycles of Fig. 14.

    Each lasts `duration` (s), to the nearest integer number of cycles. The paper's cycles have forces (N) at the tip,
    and are left out without any.
    """
    amplitude = statics.reach(inst)
    count = max(1, round(duration / _PLAIN_PERIOD))
    found: dict[str, tuple[Phase, ...]] = {
        "plain cycles": (Cycles(amplitude=amplitude, period=duration / count, count=count),)
    }
    each = duration / max(1, len(forces)) - _PAPER_LOADING - _PAPER_RESTING
    if forces and each > 0:
        loaded = [
            (
                Ramp(force=force, duration=_PAPER_LOADING),
                Hold(duration=_PAPER_RESTING),
                Cycles(amplitude=amplitude, period=each / _PAPER_CYCLES, count=_PAPER_CYCLES),
            )
            for force in forces
        ]
        found["the paper's cycles"] = tuple(phase for phases in loaded for phase in phases)
    return found


def _cycles(reach: float, forces: Sequence[float]) -> Iterator[Candidate]:
    for force, share, (pace, speed) in product((0.0, *forces), AMPLITUDES, SPEEDS.items()):
        yield _there_and_back(share * reach, force, pace, speed)
    for force in forces:
        yield _there_and_back(reach, -force, "slow", SPEEDS["slow"])


def _there_and_back(amplitude: float, force: float, pace: str, speed: float) -> Candidate:
    name = f"{pace} cycle to ±{_degrees(amplitude):g}° {_under(force)}"
    return Candidate(name, "cycles", _loaded(force, _strokes_of_hand(amplitude, speed)))


def _strokes_of_hand(amplitude: float, speed: float) -> tuple[Phase, ...]:
    ends = (_rounded(amplitude), -_rounded(amplitude))
    return tuple(Cycles(amplitude=end, speed=speed, count=1) for end in ends)


def _step_loads(reach: float, forces: Sequence[float]) -> Iterator[Candidate]:
    for force, share in product(forces, (0.0, 0.5, 1.0)):
        step = StepLoad(force=force, rise=_RISE, duration=_STEP_TIME, release=_STEP_TIME)
        yield Candidate(f"step load of {force:g} N {_at(share * reach)}", "step load", _bent(share * reach, (step,)))


def _reversals(reach: float, forces: Sequence[float]) -> Iterator[Candidate]:
    for force, share in product(forces, (0.0, 0.5)):
        there = Ramp(force=force, duration=_REVERSAL_TIME)
        over = Ramp(force=-force, duration=2 * _REVERSAL_TIME)
        back = Ramp(force=0.0, duration=_REVERSAL_TIME)
        name = f"load reversal of ±{force:g} N {_at(share * reach)}"
        yield Candidate(name, "load reversal", _bent(share * reach, (there, over, back)))


def _strokes(inst: ShortForm, reach: float, forces: Sequence[float]) -> Iterator[Candidate]:
    ways = {"pull": (1.0, 1.0), "release": (-1.0, -1.0), "pull against each other": (1.0, -1.0)}
    for (word, way), share, force in product(ways.items(), (0.0, 0.5), (0.0, *_middle(forces))):
        out, back = _wound(inst, way, STROKE)
        name = f"{word} of both spools {_at(share * reach)} {_under(force)}"
        phases = _bent(share * reach, _loaded(force, (*out, *back)))
        yield Candidate(name, "spools", phases)
    for word, way in (("both tendons", (-1.0, -1.0)), ("the agonist", (-1.0, 0.0)), ("the antagonist", (0.0, -1.0))):
        out, back = _wound(inst, way, SLACKENING)
        yield Candidate(f"{word} let slack", "spools", (*out, *back))


def _levels(inst: ShortForm, reach: float, forces: Sequence[float]) -> Iterator[Candidate]:
    for sign, force, share in product((1.0, -1.0), (0.0, *_middle(forces)), AMPLITUDES[1:]):
        out, back = _wound(inst, (sign, sign), STROKE)
        level = f"{100 * (1 + sign * STROKE):g} % of the pretension"
        name = f"fast cycle to ±{_degrees(share * reach):g}° {_under(force)} at {level}"
        moving = _loaded(force, _strokes_of_hand(share * reach, SPEEDS["fast"]))
        yield Candidate(name, "pretension level", (*out, *moving, *back))


def _wound(inst: ShortForm, way: tuple[float, float], share: float) -> tuple[tuple[Phase, ...], tuple[Phase, ...]]:
    """Return phases that wind the spools so that a tension changes by a share of the pretension, and their reverse."""
    angle = share * inst.pretension / inst.tendon_stiffness / inst.drives.spool_radius
    limit = _MOST_SPEED * inst.drives.motor_speed / inst.drives.gear_ratio
    # a trapezoid of speed
    steady = round(max(_STROKE_TIME, angle / limit), 2)
    speed = float(f"{angle / (steady + _SPEEDING):.3g}")

    def stroke(sign: float) -> tuple[Phase, ...]:
        velocity = (sign * way[0] * speed, sign * way[1] * speed)
        return (
            Ramp(spool_velocity=velocity, duration=_SPEEDING),
            Hold(duration=steady),
            Ramp(spool_velocity=(0.0, 0.0), duration=_SPEEDING),
            Hold(duration=_DWELL),
        )

    return stroke(1.0), stroke(-1.0)


def _loaded(force: float, phases: Sequence[Phase]) -> tuple[Phase, ...]:
    if not force:
        return tuple(phases)
    return (Ramp(force=force, duration=_LOADING), *phases, Ramp(force=0.0, duration=_LOADING))


def _bent(angle: float, phases: Sequence[Phase]) -> tuple[Phase, ...]:
    if not angle:
        return tuple(phases)
    seconds = round(angle / SPEEDS["fast"], 2) or 0.01
    return (
        Ramp(handle_angle=_rounded(angle), duration=seconds),
        *phases,
        Ramp(handle_angle=0.0, duration=seconds),
    )


def _middle(forces: Sequence[float]) -> Sequence[float]:
    return forces[(len(forces) - 1) // 2 :][:1]


def _degrees(angle: float) -> float:
    # rounded down, so that no share is beyond the range
    return math.floor(math.degrees(angle) * 10 + 1e-6) / 10


def _rounded(angle: float) -> float:
    return math.radians(_degrees(angle))


def _under(force: float) -> str:
    return f"under {force:g} N" if force else "without load"


def _at(angle: float) -> str:
    return f"at {_degrees(angle):g}°" if angle else "straight"
