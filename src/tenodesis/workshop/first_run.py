"""The first run of a scale model: its protocol, what must be read at every step, and what the motors must do."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tenodesis import statics
from tenodesis.control import Controller
from tenodesis.control.parameters import tension_limit
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.scaling import Design, TestLoad
from tenodesis.simulate import Protocol, execute
from tenodesis.simulate.protocol import parse
from tenodesis.twin import Twin

UNCERTAIN = (0.5, 2.0)
"""Share of the guessed friction between which a reading must lie."""
MARGIN = 1.5
"""Of the motors' torque and speed over what the twin's runs need."""
_OF_SLACK = 0.8  # of the load at which a tendon goes slack: the largest load of the first ten minutes
_SMALL = np.radians(20)  # rad, output
_SPEED = np.radians(10)  # rad/s, handle
_LEAST_TOLERANCE = 0.5  # N
_DELAY, _RISE, _HELD = 0.5, 0.5, 2.0  # s, of a load
_WINDOW = 0.5  # s, over which readings are averaged
_SHARE_OF_RANGE = 0.02  # of a reading: what encoders and cells leave open


class Reading(NamedTuple):
    """What must be read at a step of the first run, in deg or N."""

    step: str
    what: str
    unit: str
    expected: float
    low: float
    high: float
    otherwise: str
    """What to look for if it is not."""


class Demand(NamedTuple):
    """What a drive must do at its spool, from the twin's runs under the controller; speeds without a margin."""

    seen: float
    """N, largest in the runs."""
    largest_tension: float
    """N, the same with a margin, or the controller's limit if that is more."""
    torque: float
    """N*m at the spool, at that tension."""
    rms_torque: float
    speed: float
    """rad/s."""
    acceleration: float
    """rad/s^2."""

    @property
    def inertia(self) -> float:
        """Largest inertia of rotor and gearing at the spool, kg*m^2, that the margin of torque accelerates."""
        return (MARGIN - 1) * self.torque / self.acceleration


@dataclass(frozen=True)
class FirstRun:
    """The first ten minutes of a scale model, as the twin has them; :func:`rehearse` makes it."""

    protocol: Protocol
    readings: tuple[Reading, ...]
    demand: Demand
    left: float
    """Largest difference in output angle, deg, that the controller leaves under a load of the protocol, at rest."""
    faults: int
    """Mask of the controller's faults over the protocol; 0 if there is none."""


def protocol(design: Design) -> Protocol:
    """Return the protocol of the first ten minutes of a design: tighten, move, and load within what keeps it taut."""
    return parse(protocol_text(design), "first-run.toml")


def protocol_text(design: Design) -> str:
    """Return the text of the file of that protocol."""
    inst = design.scaled_up.planar[0]
    end, speed = math.degrees(inst.output_range), math.degrees(min(_SPEED, statics.reach(inst) / 2))
    phases = [
        "# The motors wind until both load cells read the pretension; under a controller this is its homing.",
        _phase("pretension", tension=f"{inst.pretension:.6g} N", tolerance=f"{_tolerance(inst):.3g} N", timeout="60 s"),
        _phase("hold", duration="2 s"),
        "# A little to one side, then all the way to either.",
        *(
            _phase("cycles", output_amplitude=f"{angle:.6g} deg", speed=f"{speed:.4g} deg/s", count=count)
            for angle, count in ((min(math.degrees(_SMALL), end), 2), (end, 1), (-end, 1))
        ),
    ]
    for test in _loads(design):
        masses = test.weights.sentence.partition(":")[0]
        phases += [
            f"# {masses}: {test.real_force:.3g} N on the real-size tip.",
            _phase(
                "step-load", handle_angle="0 deg", weight=f"{test.weights.weight:.9g} N", delay=f"{_DELAY:g} s",
                rise=f"{_RISE:g} s", duration=f"{_HELD:g} s", release=f"{_HELD:g} s",
            ),
        ]  # fmt: skip
    head = [
        f"# From rope to loaded tip in ten minutes, for {inst.name}. On the twin:",
        "#",
        "#   tenodesis record scaled-up.toml first-run.toml",
        "#   tenodesis record scaled-up.toml first-run.toml --law robust",
        "",
        'name = "first ten minutes"',
        'description = "Tighten, move a little, move all the way, load and unload"',
        "",
    ]
    return "\n".join([*head, *phases])


def _phase(kind: str, **values: str | int) -> str:
    rows = [f"{key} = {value}" if isinstance(value, int) else f'{key} = "{value}"' for key, value in values.items()]
    return "\n".join(["[[phases]]", f'kind = "{kind}"', *rows, ""])


def _tolerance(inst: Instrument) -> float:
    """Return how far a load cell may read off the pretension, N."""
    return max(_LEAST_TOLERANCE, 0.01 * inst.pretension)


def _loads(design: Design) -> list[TestLoad]:
    """Return the test loads that no tendon goes slack under; at least the smallest."""
    inst = design.scaled_up.planar[0]
    bound = _OF_SLACK * float(statics.slack_force(inst, 0.0))
    tests = sorted((test for test in design.tests if test.force > 0), key=lambda test: test.force)
    return [test for test in tests if test.force <= bound] or tests[:1]


def rehearse(design: Design) -> FirstRun:
    """Run the first ten minutes of a design on the twin, without and with the controller.

    Raises ProtocolError if the twin cannot run the protocol.
    """
    inst = design.scaled_up.planar[0]
    planned = protocol(design)
    runs = [_phases(_rubbing(inst, share), planned) for share in (1.0, *UNCERTAIN)]
    controller = Controller(inst, homed=False)
    closed = _phases(inst, planned, controller)
    faults = [int(value) for run in closed for value in np.unique(np.asarray(run["faults"]).astype(np.int64))]
    loaded = closed[len(closed) - len(_loads(design)) :]
    left = max((abs(_moved(run, _loaded(run))) for run in loaded), default=0.0)
    return FirstRun(
        planned, tuple(_readings(design, planned, runs)), _demand(inst, closed), left, int(np.bitwise_or.reduce(faults))
    )


def _phases(inst: Instrument, planned: Protocol, controller: Controller | None = None) -> list[Run]:
    """Return the run of every phase, one after another on the same twin, whose tendons are slack before."""
    twin = Twin(inst)
    twin.loosen(max(2e-3, 1.25 * inst.pretension / inst.tendon_stiffness))
    return [execute(twin, planned.model_copy(update={"phases": (phase,)}), controller) for phase in planned.phases]


def _rubbing(inst: Instrument, share: float) -> Instrument:
    friction = inst.friction
    return inst.replace(
        **{
            "friction.vertex_coefficient": share * friction.vertex_coefficient,
            "friction.sheath_coefficient": share * friction.sheath_coefficient,
        }
    )


def _readings(design: Design, planned: Protocol, runs: Sequence[Sequence[Run]]) -> Iterator[Reading]:
    """Yield what must be read; of the runs the first has the guessed friction."""
    inst = design.scaled_up.planar[0]
    tolerance = _tolerance(inst)
    for n, name in enumerate(("agonist", "antagonist")):
        read = [float(np.mean(_last(run[0], "measured_tension")[:, n])) for run in runs]
        yield _reading(
            "tighten", f"load cell, {name}", "N", [inst.pretension, *read], tolerance,
            "rope not seated, cell not tared, spool slips",
        )  # fmt: skip
    turned = [float(np.degrees(np.mean(_last(run[1], "measured_output_angle")))) for run in runs]
    yield _reading("tighten", "tip", "deg", [0.0, *turned], 1.0, "cells differ in gain: swap them and see")
    for n, angle in ((2, min(_SMALL, inst.output_range)), (3, inst.output_range), (4, -inst.output_range)):
        step = f"move to {np.degrees(angle):.0f}°"
        sign = np.sign(angle)
        reached = [float(np.degrees(sign * (sign * run[n]["measured_output_angle"]).max())) for run in runs]
        yield _reading(step, "tip, farthest", "deg", reached, 0.5, "radii, or a tendon that slips on its wheel")
        strained = [float(run[n]["measured_tension"].max()) for run in runs]
        yield _reading(
            step, "load cells, largest", "N", strained, _SHARE_OF_RANGE * inst.pretension,
            "more: a sharp or dirty vertex; less: slack in a termination",
        )  # fmt: skip
    for n, test in enumerate(_loads(design), len(planned.phases) - len(_loads(design))):
        step = f"load {test.real_force:.3g} N real-size, {test.force:.3g} N"
        moved = [_moved(run[n], _loaded(run[n])) for run in runs]
        yield _reading(
            step, "tip, change under the load", "deg", moved, 0.3, "more: rope softer than assumed, or slack"
        )
        for tendon, name in enumerate(("agonist", "antagonist")):
            pulled = [float(np.mean(run[n]["measured_tension"][_loaded(run[n]), tendon])) for run in runs]
            yield _reading(
                step, f"load cell, {name}", "N", pulled, _SHARE_OF_RANGE * inst.pretension,
                "friction in the sheath; weights on the wrong cable",
            )  # fmt: skip


def _reading(  # noqa: PLR0917
    step: str, what: str, unit: str, values: Sequence[float], tolerance: float, otherwise: str
) -> Reading:
    return Reading(step, what, unit, values[0], min(values) - tolerance, max(values) + tolerance, otherwise)


def _last(run: Run, name: str) -> Array:
    end = run.time[-1]
    found: Array = run[name][run.time >= end - _WINDOW]
    return found


def _loaded(run: Run) -> Array:
    """Return which steps of a step load are at its end, before the release."""
    end = run.time[-1] - _HELD - _RISE
    mask: Array = (run.time >= end - _WINDOW) & (run.time < end)
    return mask


def _moved(run: Run, at: Array) -> float:
    """Return by how much the tip reads off its angle at the start of a run, deg."""
    angle = run["measured_output_angle"]
    before = angle[run.time < run.time[0] + 0.4]
    return float(np.degrees(np.mean(angle[at]) - np.mean(before)))


def _demand(inst: Instrument, runs: Sequence[Run]) -> Demand:
    radius = inst.drives.spool_radius
    tension = np.concatenate([run["tension"] for run in runs])
    velocity = np.concatenate([run["spool_velocity"] for run in runs])
    time = np.concatenate([run.time for run in runs])
    step = float(np.median(np.diff(time)))
    seen = float(tension.max())
    largest = max(MARGIN * seen, tension_limit(inst))
    return Demand(
        seen,
        largest,
        largest * radius,
        float(np.sqrt(np.mean(tension**2, axis=0)).max()) * radius,
        float(np.abs(velocity).max()),
        float(np.abs(np.diff(velocity, axis=0)).max() / step),
    )
