"""Claims about faults: each is detected in time and by its name and moves the tip little; normal work is none."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import FAULTS, Controller, OperatingState, Request, parameters
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.simulate import FaultInjection
from tenodesis.twin import TIME_STEP, Twin

from .conftest import load_study

LOADED = 1.5  # s
FAULT = 1.8  # s: the motors are at work
LOADS = {"scaled-up": 1.485, "real-size": 0.52}  # N; 0.15 N m on the large one, and the same on the small one
# Of the faults' cases with these, pairs: each fault with both instruments and with every angle.
PAIRED = [("scaled-up", 0), ("scaled-up", 80), ("real-size", 33), ("real-size", 67)]
CONFIGURATIONS = [(name, deg) for name in LOADS for deg in (0, 33, 67, 80) if name == "scaled-up" or deg in (33, 67)]
CONTROLLERS = [("friction", "robust", "differential")]
OTHERS = [("exact", "exact", "differential"), ("friction", "robust", "agonist")]
TOO_LITTLE = 0.3  # of the pretension: half of it, the mean's share, is near the limit of a spool's slip
MOST_MOTION = np.radians(2)  # issue 4: from the fault to the safe state, beyond what a load itself causes


normal = load_study("faults")


class Case(NamedTuple):
    """A fault as it is injected into the twin, the names it may be given, how soon, and why no sooner."""

    named: tuple[str, ...]
    within: float
    """s"""
    why: str
    injected: tuple[FaultInjection, ...] = ()
    let_out: tuple[float, float, float] | None = None
    """Of a tendon (0 agonist, 1 antagonist, 2 both): length in stretches by the pretension, and in how long, s."""
    start: float = FAULT


def inject(point: Any, mode: Any, value: float = 0.0, start: float = FAULT, stop: float = np.inf) -> Any:
    return (FaultInjection(point, mode, value, start=start, stop=stop),)


ONE_TICK = "no condition has to last"
STUCK = "40 ms without a flicker: fewer samples may be equal by chance"
RANGE = "lasts 5 ms, since a single bad sample is none"
JUMP = "the second sample confirms the first"
TORN = "lasts 10 ms, longer than a sample's error"
DEAD = "a cell that is dead at once shows what one beside a broken tendon shows"
SAME = "what lets out more than a tendon is stretched by has it hang: a slip is a break then"
LAGS = "from the load on: a motor that is asked to move slowly takes long to lag by 8 mrad, 40 um of tendon"

CASES = {
    "agonist breaks": Case(("tendon_break",), 0.012, TORN, let_out=(0, 200, 0)),
    "antagonist breaks": Case(("tendon_break",), 0.012, TORN, let_out=(1, 200, 0)),
    "agonist's spool slips": Case(("spool_slip", "tendon_break"), 0.02, SAME, let_out=(0, 0.58, 0)),
    "antagonist's spool slips": Case(("spool_slip", "tendon_break"), 0.02, SAME, let_out=(1, 0.58, 0)),
    "both tendons pulled": Case(
        ("over_tension", "load_cell_drift"), 0.15, "pulled for 0.1 s; the limit is four pretensions", (), (2, -4, 0.1)
    ),
    "agonist's cell at 150 N": Case(
        ("over_tension",), 0.005, "lasts 3 ms, as a blow may exceed it", inject("tension.agonist", "set", 150.0)
    ),
    "agonist's cell stuck": Case(("load_cell_stuck",), 0.045, STUCK, inject("tension.agonist", "hold")),
    "antagonist's cell stuck": Case(("load_cell_stuck",), 0.045, STUCK, inject("tension.antagonist", "hold")),
    "cell dead": Case(("load_cell_stuck", "tendon_break"), 0.045, DEAD, inject("tension.antagonist", "set", 0.0)),
    "cell at its end": Case(("load_cell_range",), 0.006, RANGE, inject("tension.agonist", "set", 200.0)),
    "cell far below zero": Case(("load_cell_range",), 0.006, RANGE, inject("tension.antagonist", "set", -50.0)),
    "encoder drops out": Case(("encoder_dropout",), 0.006, RANGE, inject("handle_angle", "set", -np.pi)),
    "encoder jumps": Case(("encoder_jump",), 0.0015, JUMP, inject("handle_angle", "add", 0.3)),
    "encoder jumps back": Case(("encoder_jump",), 0.0015, JUMP, inject("handle_angle", "add", -0.3)),
    "spool's encoder jumps": Case(("encoder_jump",), 0.0015, JUMP, inject("spool_angle.agonist", "add", 0.3)),
    "agonist's motor stands": Case(
        ("motor_not_following",), 0.25, LAGS, inject("spool_velocity.agonist", "set", 0.0, LOADED), start=LOADED
    ),
    "antagonist's motor stands": Case(
        ("motor_not_following",), 0.25, LAGS, inject("spool_velocity.antagonist", "set", 0.0, LOADED), start=LOADED
    ),
    "tick late": Case(("tick_late",), 0.0006, ONE_TICK, inject("tick", "add", 0.05)),
    "ticks missing": Case(
        ("tick_late",), 0.0411, "detected by the next one", inject("tick", "hold", stop=FAULT + 0.04)
    ),
} | {
    f"{place} {value}": Case(("not_a_number",), 0.0006, ONE_TICK, inject(place, "set", value))
    for place in ("handle_angle", "tension.agonist", "tension.antagonist", "spool_angle.agonist")
    for value in (np.nan, np.inf)
}
SENSOR_FAULTS = {"load_cell_stuck", "load_cell_range", "encoder_dropout", "encoder_jump", "not_a_number"}


def instrument(name: str, mean_band: float | None = None) -> Instrument:
    inst = tn.load(name).axis("yaw")
    return inst if mean_band is None else inst.replace(**{"control.mean_band": mean_band})


def let_out(inst: Instrument, length: tuple[float, float, float] | None, start: float, time: Array) -> Array:
    out = np.zeros((time.size, 2))
    if length is not None:
        side, stretches, span = length
        grown = np.clip((time - start) / span, 0, 1) if span else (time > start).astype(float)
        grown = grown if side < 2 else grown[:, np.newaxis]
        out[:, slice(None) if side == 2 else int(side)] = (
            stretches * inst.pretension / normal.law.differing(inst).tendon_stiffness * grown
        )
    return out


def work(
    inst: Instrument,
    deg: float,
    controller: Controller,
    *,
    seconds: float = 2.8,
    seed: int = 3,
    lengths: tuple[float, float, float] | None = None,
    start: float = FAULT,
    fault_injection: Sequence[FaultInjection] = (),
    requests: dict[float, Request] | None = None,
    force: Callable[[Array], Array] | None = None,
    twin: Twin | None = None,
) -> Run:
    """Flex to an output angle, load the tip, and let something fail."""
    time = np.arange(1, round(seconds / TIME_STEP) + 1, dtype=np.float64) * TIME_STEP
    u = np.clip(time / 1.2, 0, 1)
    handle = float(tn.statics.handle_angle(inst, np.radians(deg))) * u**3 * (10 - 15 * u + 6 * u * u)
    request = np.zeros(time.size, int)
    for at, asked in (requests or {}).items():
        request[round(at / TIME_STEP)] = asked
    load = np.where(time > LOADED, LOADS[inst.name], 0.0) if force is None else force(time)
    return (twin or Twin(inst, seed=seed)).run(
        handle,
        load,
        controller=controller,
        request=request,
        let_out=let_out(inst, lengths, start, time),
        fault_injection=fault_injection,
    )


def controller(inst: Instrument, choice: tuple[str, str, str] = CONTROLLERS[0]) -> Controller:
    return Controller(normal.law.differing(inst), *choice)  # type: ignore[arg-type]


def names(mask: float) -> set[str]:
    return {name for n, name in enumerate(FAULTS) if int(mask) >> n & 1}


def fault_row(run: Run) -> int | None:
    at = np.flatnonzero(run["operating_state"] == OperatingState.FAULT)
    return int(at[0]) if at.size else None


def unneeded_motion(inst: Instrument, run: Run, frozen: Run, healthy: Run, first: int) -> float:
    """Return how far the tip went beyond where frozen motors, no fault or the hand would have it, rad."""
    wanted = np.asarray(tn.statics.output_angle(inst, run["handle_angle"], 0.0))
    low, high = (of([frozen["output_angle"], healthy["output_angle"], wanted], axis=0) for of in (np.min, np.max))
    tip = run["output_angle"]
    return float(np.maximum(low - tip, tip - high)[first:].max())


def check(inst: Instrument, deg: float, case: Case, choice: tuple[str, str, str]) -> None:
    asked: dict[str, Any] = {"lengths": case.let_out, "start": case.start}
    one = controller(inst, choice)
    run = work(inst, deg, one, fault_injection=case.injected, **asked)
    first = round(case.start / TIME_STEP)
    row = fault_row(run)
    commanded = run["commanded_spool_velocity"]
    if row is None and case.named == ("motor_not_following",):
        # A motor that was not asked to move has nothing to follow, and has done no harm.
        side = "agonist" not in case.injected[0].point.split(".")
        asked_for = np.abs(np.cumsum(commanded[first:, int(side)])).max() * TIME_STEP
        assert asked_for < 0.1
        return
    frozen = work(inst, deg, controller(inst, choice), requests={case.start: Request.PAUSE}, **asked)
    healthy = frozen if case.let_out else work(inst, deg, controller(inst, choice))
    assert unneeded_motion(inst, run, frozen, healthy, first) <= MOST_MOTION
    # What takes less off the mean than friction may, is found later or never, and does as little.
    carried = run["tension"][first - 1, int(case.let_out[0])] if case.let_out and case.let_out[0] < 2 else np.inf
    if carried < TOO_LITTLE * inst.pretension and (row is None or (row - first) * TIME_STEP > case.within):
        return
    assert row is not None
    assert (run["operating_state"][row:] == OperatingState.FAULT).all()
    assert names(run["faults"][row]) <= set(case.named)
    assert 0 <= (row - first) * TIME_STEP <= case.within

    limit = parameters(inst).common["acceleration_limit"]
    late = "tick_late" in case.named
    assert np.isfinite(commanded).all()
    # After a gap the ramp takes the step that its time allows.
    most = limit * (0.051 if late else TIME_STEP)
    jumps = np.abs(np.diff(commanded, axis=0))
    # Above its limit a tendon is not wound a tick longer, and afterwards relieved at the slowest pace.
    over = "over_tension" in case.named
    assert (jumps[(commanded[1:] != 0) | (not over)] <= most * (1 + 1e-9)).all()
    common = parameters(inst).common
    stopped = row + round(common["speed_limit"] / limit / TIME_STEP) + 1
    # They stand, and return thereafter.
    standing = row + round(common["hold_time"] / TIME_STEP) - 1
    assert np.abs(commanded[stopped:standing]).max() <= (common["neutral_speed"] if over else 0)
    assert np.abs(commanded[standing:]).max(initial=0) <= common["neutral_speed"] * (1 + 1e-9)

    record = one.flight_record()
    assert record.fault_row is not None
    assert names(record.faults[record.fault_row]) <= set(case.named)
    assert record.state[record.fault_row] == OperatingState.FAULT
    assert (record.state[: record.fault_row] == OperatingState.ENABLED).all()
    np.testing.assert_allclose(record.spool_velocity[record.fault_row], commanded[row], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "deg"), PAIRED, ids=str)
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_each_fault_is_detected_in_time_by_its_name_and_moves_the_tip_little(name: str, deg: float, case: Case) -> None:
    check(instrument(name), deg, case, CONTROLLERS[0])


@pytest.mark.parametrize("choice", OTHERS, ids="-".join)
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_a_fault_is_detected_whatever_the_law(case: Case, choice: tuple[str, str, str]) -> None:
    check(instrument("scaled-up"), 33, case, choice)


def test_the_flight_record_holds_the_last_200_ms_before_a_fault_and_a_few_after() -> None:
    inst = instrument("scaled-up")
    one = controller(inst)
    run = work(inst, 33, one, fault_injection=CASES["encoder jumps"].injected)
    record, row = one.flight_record(), fault_row(run)
    assert row is not None and record.fault_row is not None
    assert record.time[record.fault_row] == pytest.approx(run.time[row], abs=1e-9)
    spacing = np.diff(record.time).max()
    assert record.time[record.fault_row] - record.time[0] > 0.2 - 1.01 * spacing
    assert 0.005 < record.time[-1] - record.time[record.fault_row] < 0.05
    rows = np.searchsorted(run.time, record.time - 1e-9)
    # What a tick measures is from the end of the step before it.
    np.testing.assert_array_equal(record.state, run["operating_state"][rows])
    np.testing.assert_allclose(record.tension, run["measured_tension"][rows - 1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(record.spool_velocity, run["commanded_spool_velocity"][rows], rtol=0, atol=1e-9)


def test_every_sensor_fault_is_detected_within_50_ms() -> None:
    assert all(case.within <= 0.05 for case in CASES.values() if set(case.named) & SENSOR_FAULTS)
    named = set().union(*(case.named for case in CASES.values()))
    # These have tests of their own, homing_failed has its own file.
    assert set(FAULTS) - named == {"tendon_slack", "homing_failed", "stroke_unexplained", "rope_length"}


@pytest.mark.parametrize(("name", "deg"), CONFIGURATIONS, ids=str)
def test_a_drive_that_runs_away_is_detected_before_it_has_wound_a_tenth_of_a_turn(name: str, deg: float) -> None:
    inst = instrument(name)
    run = work(inst, deg, controller(inst), fault_injection=inject("spool_velocity.agonist", "set", 3.0))
    row = fault_row(run)
    assert row is not None and names(run["faults"][row]) == {"motor_not_following"}
    first = round(FAULT / TIME_STEP)
    # What it turns from then on no velocity that is sent can stop: that takes a drive that can be switched off.
    assert run["spool_angle"][row, 0] - run["spool_angle"][first, 0] < 0.1 * 2 * np.pi
    assert (row - first) * TIME_STEP <= 0.025


def hangs(run: Run, below: float) -> float:
    """Return the longest time that a tendon has hung without a fault, s."""
    row = fault_row(run)
    loose = run["tension"][:row].min(1) < below
    ends = np.flatnonzero(np.diff(np.concatenate([[0], loose.astype(int), [0]])))
    return float((ends[1::2] - ends[::2]).max(initial=0) * TIME_STEP)


HANGING = [("friction", "off", "differential"), *CONTROLLERS, *OTHERS]
WHYS = ["loosened", "load", "load from behind"]


# Pairs again: every cause with every configuration and every controller.
@pytest.mark.parametrize(
    ("name", "deg", "choice", "why"),
    [
        (*configuration, choice, WHYS[(n + m) % 3])
        for n, configuration in enumerate(CONFIGURATIONS)
        for m, choice in enumerate(HANGING)
    ],
)
def test_no_tendon_hangs_for_long_undetected_or_slack(
    name: str, deg: float, choice: tuple[str, str, str], why: str
) -> None:
    inst = instrument(name)
    slack = float(tn.statics.slack_force(inst, np.radians(deg)))
    side = -1.0 if why == "load from behind" else 1.0
    lengths = (1, 1.5, 2.0) if why == "loosened" else None
    force = None if lengths else lambda time: np.where(time > FAULT, side * 1.15 * slack, 0.0)
    run = work(inst, deg, controller(inst, choice), seconds=7.0, lengths=lengths, force=force)
    assert hangs(run, 0.02 * inst.pretension) < 2.1
    row = fault_row(run)
    if choice[1] == "off" and why == "load":
        assert row is not None and names(run["faults"][row]) == {"tendon_slack"}
        assert abs(row * TIME_STEP - FAULT - 2.0) < 0.3
    elif row is not None:
        assert names(run["faults"][row]) <= {
            "tendon_slack",
            "tendon_break",
            "load_cell_drift",
            "spool_slip",
            "rope_length",
        }


@pytest.mark.parametrize("rate", [20.0, -20.0, 5.0, -5.0])
@pytest.mark.parametrize(("name", "deg"), CONFIGURATIONS, ids=str)
def test_a_drifting_cell_is_detected_before_it_is_off_by_two_pretensions(name: str, deg: float, rate: float) -> None:
    # Friction may move the mean of the pair by mean_band, and all that is within it is as good as a load. What is known
    # of the two instruments' friction, sheath bent by a quarter turn included, comes to 0.3.
    inst = instrument(name, 0.3)
    side = "agonist" if rate > 0 else "antagonist"
    drift = (FaultInjection(f"tension.{side}", "add", rate=rate, start=FAULT),)  # type: ignore[arg-type]
    run = work(inst, deg, controller(inst), seconds=FAULT + 2.2 * inst.pretension / abs(rate), fault_injection=drift)
    row = fault_row(run)
    assert row is not None
    # A cell that says less and less looks like a tendon that comes to hang.
    expected = {"load_cell_drift", "load_cell_range", "tendon_break", "tendon_slack", "over_tension", "spool_slip"}
    # The sum of two tensions does not tell a rope that gets longer from a cell that drifts.
    expected |= {"rope_length"}
    assert names(run["faults"][row]) <= expected
    # The law winds a tendon whose cell reads less and less, which keeps the reading up.
    assert (row * TIME_STEP - FAULT) * abs(rate) < 2.1 * inst.pretension


@pytest.mark.parametrize("place", ["handle_angle", "tension.agonist", "spool_angle.antagonist"])
def test_a_fault_is_not_cleared_before_its_cause_is_gone(place: str) -> None:
    inst = instrument("scaled-up")
    one = controller(inst)
    run = work(
        inst,
        33,
        one,
        seconds=5.0,
        fault_injection=inject(place, "set", np.nan, stop=2.5),
        requests={2.2: Request.CLEAR, 2.3: Request.ENABLE, 3.0: Request.CLEAR, 3.5: Request.ENABLE},
    )
    state = run["operating_state"]
    at = [round(t / TIME_STEP) + 2 for t in (1.9, 2.25, 2.4, 2.9, 3.2, 4.9)]
    fault, disabled, enabled = OperatingState.FAULT, OperatingState.DISABLED, OperatingState.ENABLED
    assert state[at].tolist() == [fault, fault, fault, fault, disabled, enabled]
    # Bumpless: what was lost meanwhile comes back at the usual pace.
    again = round(3.5 / TIME_STEP)
    commanded = run["commanded_spool_velocity"]
    limit = parameters(inst).common["acceleration_limit"]
    assert np.abs(np.diff(commanded, axis=0)).max() <= limit * TIME_STEP * (1 + 1e-9)
    assert np.abs(commanded[again : again + 3]).max() < 0.1
    assert np.abs(np.diff(run["output_angle"][again:])).max() / TIME_STEP < np.radians(60)
    target = float(tn.statics.output_angle(inst, run["handle_angle"][-1], 0.0))
    assert abs(run["output_angle"][-1] - target) < np.radians(0.7)


@pytest.mark.parametrize("case", ["agonist breaks", "agonist's spool slips", "spool's encoder jumps"])
def test_after_a_fault_that_leaves_the_spools_zero_unknown_homing_comes_before_compensation(case: str) -> None:
    inst = instrument("scaled-up")
    one, twin, fault = controller(inst), Twin(inst, seed=3), CASES[case]
    work(inst, 0, one, lengths=fault.let_out, fault_injection=fault.injected, twin=twin, force=np.zeros_like)
    count = round(12 / TIME_STEP)
    request = np.zeros(count, int)
    for at, asked in ((0.1, Request.CLEAR), (0.3, Request.ENABLE), (0.5, Request.HOME), (11.0, Request.RESUME)):
        request[round(at / TIME_STEP)] = asked
    time = 10 + np.arange(count, dtype=np.float64) * TIME_STEP
    kept = [replace(one, start=0.0, stop=np.inf) for one in fault.injected]
    run = twin.run(
        np.zeros(count),
        controller=one,
        request=request,
        let_out=let_out(inst, fault.let_out, FAULT, time),
        fault_injection=kept,
    )
    state = run["operating_state"]
    assert state[round(0.4 / TIME_STEP)] == OperatingState.DISABLED
    assert (run["commanded_spool_velocity"][: round(0.5 / TIME_STEP)] == 0).all()
    if case == "agonist breaks":
        row = int(np.flatnonzero(state[round(0.5 / TIME_STEP) :] == OperatingState.FAULT)[0]) + round(0.5 / TIME_STEP)
        assert names(run["faults"][row]) == {"homing_failed", "tendon_break"}
    else:
        assert state[round(10.9 / TIME_STEP)] == OperatingState.PAUSED
        assert state[-1] == OperatingState.ENABLED
        assert np.abs(run["tension"][-1] / inst.pretension - 1).max() < 0.5


@pytest.mark.parametrize("band", [None, 0.3], ids=["default band", "band of 0.3"])
@pytest.mark.parametrize("name", LOADS)
def test_normal_work_is_never_taken_for_a_fault(name: str, band: float | None) -> None:
    inst = instrument(name, band)
    # Ten minutes of work over all instruments, bands and settings.
    seconds = 600 / len(normal.SETTINGS) / 4
    for n, setting in enumerate(normal.SETTINGS):
        parts = list(normal.watched(inst, setting, seed=n, seconds=seconds))
        assert sum(part.ticks for part in parts) * TIME_STEP >= seconds
        assert [fault for part in parts for fault in part.false_faults] == []
