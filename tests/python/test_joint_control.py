"""Observer and law for any routing: joints whose tendons turn several of them, with and without a handle."""

from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import IdentificationError, ProtocolError
from tenodesis.identification.force.observed import observed
from tenodesis.instrument import FullForm, expanded
from tenodesis.recording import Recording, lab_tables, summary, tables
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record

from .conftest import refused

STEPS = 6000
FRICTION = {"law": "capstan", "sheath_bend": 0.35}


def with_friction(name: str, coefficient: float) -> FullForm:
    own = {"vertex_coefficient": coefficient, "sheath_coefficient": coefficient}
    return expanded(name).replace(friction=FRICTION | own)


def eased(start: float, span: float) -> np.ndarray:
    share = np.clip((np.arange(1, STEPS + 1) * 5e-4 - start) / span, 0, 1)
    return (share**2 * (3 - 2 * share))[:, np.newaxis]


def left_over(
    truth: FullForm, assumed: FullForm, target: list[float], force: list[float], compensates: bool
) -> tuple[np.ndarray, tn.control.JointEstimate, tn.Run]:
    """Return by what bends what is left of a load's error at the end, deg."""
    angles = truth.bent(target)
    controller = tn.control.JointController(assumed, "joints" if compensates else "off")
    wrench = eased(1.2, 0.3) * np.array([*force, 0, 0, 0])
    handle = np.zeros((STEPS, len(truth.handle_joints)))
    run = tn.twin.Twin(truth).run(handle, controller=controller, target=eased(0, 1) * angles, wrench=wrench)
    off = run["output_angle"][-200:].mean(axis=0) - angles
    return np.degrees([off[places].sum() for places in truth.bends.values()]), controller.estimate, run


@pytest.mark.parametrize("scale", [0.7, 1.0, 1.3])
@pytest.mark.parametrize("name", ["needle-driver", "maryland-dissector"])
def test_jaws_over_a_wrist_come_back_under_load_whatever_friction(name: str, scale: float) -> None:
    truth, assumed = with_friction(name, 0.1 * scale), with_friction(name, 0.1)
    case = ([0.4, -0.3, 0.5], [6.0, 5.0, 0.5])
    off, _, _ = left_over(truth, assumed, *case, compensates=False)
    left, estimate, run = left_over(truth, assumed, *case, compensates=True)
    assert np.abs(off).max() > 1.5
    assert np.abs(left).max() < 0.7
    error = estimate.angle[-1] - run["output_angle"][-1]
    assert (np.abs(error) < 3 * estimate.angle_std[-1]).all()


def test_a_slow_tip_does_not_swing_on_after_a_move() -> None:
    # as heavy as a scale model's, without friction: it swings at 2.5 Hz
    inst = expanded(tn.load("needle-driver"))
    slow = inst.replace(**{f"joints.{joint.name}.mass": 10.0 for joint in inst.tip_joints})
    twin = tn.twin.Twin(slow, seed=0)
    time = np.arange(round(6 / twin.time_step)) * twin.time_step
    target = np.outer(np.clip(time - 1, 0, 1), [0.35, 0.0, 0.0])
    run = twin.run(np.zeros((time.size, 0)), controller=tn.control.JointController(slow), target=target)
    assert np.degrees(np.ptp(run["output_angle"][time > 5], axis=0)).max() < 0.02


def test_segments_that_droop_reach_what_is_commanded() -> None:
    inst = expanded("two-segment-continuum")
    off, _, _ = left_over(inst, inst, [0.5, -0.3], [0.1, 0.0, 0.1], compensates=False)
    left, _, _ = left_over(inst, inst, [0.5, -0.3], [0.1, 0.0, 0.1], compensates=True)
    assert np.abs(off).max() > 5
    assert np.abs(left).max() < 0.5


def test_with_a_handle_its_angles_are_the_targets() -> None:
    inst = expanded("hybrid-real-size")
    controller = tn.control.JointController(inst)
    handle = eased(0, 1) * np.array([0.2, -0.15, 0.0])
    wrench = eased(1.2, 0.3) * np.array([0.2, 0.2, 0, 0, 0, 0])
    run = tn.twin.Twin(inst).run(handle, controller=controller, wrench=wrench)
    assert run.commanded_output_angle is None
    planar = tn.control.compensated(inst)
    for n, axis in enumerate(("yaw", "pitch")):
        wanted = tn.statics.output_angle(planar.axis(axis), handle[-1, n], 0.0)
        assert np.degrees(run["output_angle"][-1, n] - wanted) == pytest.approx(0, abs=0.7)


@pytest.mark.parametrize("name", ["hybrid-real-size", "hybrid-scaled-up"])
def test_an_object_is_gripped_as_the_trigger_asks_whatever_its_encoder_reads(name: str) -> None:
    inst = with_friction(name, 0.1)
    handle = eased(0, 1) * [0, 0, 0.225] + eased(1.2, 1) * [0.3, 0.3, 0]
    held = tn.twin.Held(-0.15 * float(inst.grip_arms.max()), 3e3, 1.0)
    grips = []
    for law in ("off", "joints"):
        run = tn.twin.Twin(inst).run(handle, controller=tn.control.JointController(inst, law), held=held)
        grips.append(run["grip_force"][2400:])
    assert grips[0].min() > 0.5
    np.testing.assert_allclose(grips[1], grips[0], rtol=0.01)


def test_homing_learns_how_stiff_and_rough_tendons_are_and_turns_no_joint() -> None:
    assumed = with_friction("hybrid-real-size", 0.1)
    truth = with_friction("hybrid-real-size", 0.13).replace(tendon_modulus=45e9)
    way = eased(2.1, 0.3)
    handle = way * np.array([0.2, -0.3, 0.0])
    target = tn.statics.unloaded_angle(truth, handle[-1])
    wrench = eased(2.1, 0.3) * np.array([1.0, 0.5, 0, 0, 0, 0])
    request = np.zeros(STEPS, dtype=int)
    request[0], request[4200] = tn.control.Request.HOME, tn.control.Request.RESUME
    off = {}
    for homes in (False, True):
        controller = tn.control.JointController(assumed)
        run = tn.twin.Twin(truth).run(handle, controller=controller, wrench=wrench, request=request * homes)
        off[homes] = np.degrees(run["output_angle"][-1] - target)[:2]
        if homes:
            assert (run["operating_state"][4150] == tn.control.OperatingState.PAUSED).all()
            assert np.abs(np.degrees(run["output_angle"][:4200])).max() < 0.1
            assert controller.estimate.friction_scale[4200] == pytest.approx(1.3, abs=0.1)
            assert controller.estimate.friction_scale_std[4200] < assumed.control.friction_uncertainty / 2
    assert np.abs(off[True]).max() < 0.5 < np.abs(off[False]).max()


def test_a_cell_that_is_off_after_homing_is_named_before_the_tip_has_moved_a_degree() -> None:
    inst = with_friction("needle-driver", 0.1)
    twin, controller = tn.twin.Twin(inst, seed=1), tn.control.JointController(inst)
    velocity, faults = np.zeros((1, 6)), []
    requests = {0: "home", 4100: "resume"}
    for tick in range(6000):
        run = twin.run(np.zeros((1, 0)), spool_velocity=velocity)
        tension = run["measured_tension"][0] + np.array([0, 0, 5.0, 0, 0, 0]) * (tick > 4500)
        out = controller.step(tension, run["measured_spool_angle"][0], request=requests.get(tick, "none"))
        velocity = out.spool_velocity[np.newaxis]
        assert np.abs(np.degrees(run["output_angle"])).max() < 1
        assert not out.faults or tick > 4500
        faults += out.faults
    assert set(faults) == {"load_cell_drift"}


def test_a_tick_is_that_of_the_loop_and_reset_starts_again() -> None:
    inst = expanded("needle-driver")
    controller = tn.control.JointController(inst)
    measured = np.array([21.0, 19.0, 20.0, 20.0, 20.0, 20.0]), np.zeros(6)
    first = controller.step(*measured)
    estimate = first.estimate
    controller.step(*measured, target=[0.1, 0.0, 0.0])
    controller.reset()
    again = controller.step(*measured)
    assert first.state == again.state == tn.control.OperatingState.ENABLED
    assert np.array_equal(first.spool_velocity, again.spool_velocity)
    assert np.array_equal(estimate.covariance, again.estimate.covariance)
    assert estimate.angle_std == pytest.approx(np.sqrt(np.diag(estimate.covariance)))
    assert estimate.moment[0] == pytest.approx(2 * 2.5e-3, rel=0.1)


def steady(controller: tn.control.JointController, ticks: int, **changed: tuple[int, float]) -> tn.control.JointOutput:
    """Return the last of some ticks that follow a target with readings at rest, of which one has another value."""
    noise = np.random.default_rng(1)
    for _ in range(ticks):
        spools = np.zeros(6)
        tensions = 20 + 0.05 * noise.standard_normal(6)
        for name, (at, value) in changed.items():
            (tensions if name == "tension" else spools)[at] = value
        out = controller.step(tensions, spools, target=np.zeros(3))
    return out


@pytest.mark.parametrize(
    ("reading", "fault"),
    [
        ({"tension": (2, np.nan)}, "not_a_number"),
        ({"spool": (1, np.inf)}, "not_a_number"),
        ({"tension": (3, 20.0)}, "load_cell_stuck"),
        ({"tension": (3, 101.0)}, "over_tension"),
        ({"tension": (3, -3.0)}, "load_cell_range"),
        ({"tension": (0, 45.0)}, "load_cell_drift"),
        ({"tension": (4, 0.0)}, "tendon_break"),
        ({"spool": (5, 0.3)}, "encoder_jump"),
    ],
)
def test_what_sensors_cannot_read_stops_the_motors_and_is_latched(reading: dict, fault: str) -> None:
    # With a law its motors would not follow here.
    controller = tn.control.JointController("needle-driver", "off")
    assert steady(controller, 100).state == tn.control.OperatingState.ENABLED
    found = steady(controller, 1500, **reading)
    assert found.state == tn.control.OperatingState.FAULT
    assert fault in found.faults
    assert not found.spool_velocity.any()
    assert not steady(controller, 200).spool_velocity.any()
    assert fault in steady(controller, 1).faults


def test_ticks_that_stay_away_are_a_fault_that_is_cleared_by_request() -> None:
    controller = tn.control.JointController("needle-driver")
    steady(controller, 10)
    late = controller.step(np.full(6, 20.0), np.zeros(6), since=0.1)
    assert late.first_faults == ("tick_late",)
    controller.ask("clear")
    assert steady(controller, 2).state == tn.control.OperatingState.DISABLED
    controller.ask("enable")
    assert steady(controller, 1).state == tn.control.OperatingState.ENABLED


def test_a_torn_tendon_is_named_and_the_motors_stand() -> None:
    torn = np.zeros((2000, 6))
    torn[1000:, 2] = 0.5
    controller = tn.control.JointController("needle-driver")
    with pytest.warns(tn.errors.FaultWarning, match="tendon_break"):
        run = tn.twin.Twin("needle-driver").run(np.zeros((2000, 0)), controller=controller, let_out=torn)
    assert 0.5 < run.fault_times["tendon_break"] < 0.52
    assert not run["commanded_spool_velocity"][1100:].any()


@pytest.mark.parametrize("home", [False, True])
def test_a_law_of_all_joints_is_recorded_and_replayed_bit_by_bit(tmp_path: Path, home: bool) -> None:
    controller = tn.control.JointController("needle-driver")
    protocol = tn.simulate.Protocol(
        name="wrist",
        phases=[
            {"kind": "ramp", "duration": 0.5, "spool_velocities": {"pitch_wound": 0.4, "pitch_unwound": -0.4}},
            {"kind": "ramp", "duration": 0.1, "spool_velocities": {"pitch_wound": 0.0, "pitch_unwound": 0.0}},
            {"kind": "step-load", "duration": 0.3, "wrench": {"fy": 3.0}},
        ],
    )
    path = tmp_path / "wrist.mcap"
    run = record("needle-driver", protocol, path, controller=controller, home=home)
    assert run.compensated == run.joints
    assert run.time[-1] > (2.9 if home else 0.8)
    assert run["commanded_output_angle.pitch"][-1] == pytest.approx(0.12 * 2.5465 / 2.5, abs=1e-3)
    recording = Recording.open(path)
    assert np.array_equal(recording.run["commanded_output_angle"], run["commanded_output_angle"])
    assert replay(recording).exact
    assert "joints law" in summary.facts(summary.read(path))["controller"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "home"), [("needle-driver", False), ("hybrid-real-size", True)])
def test_slack_tendons_are_tightened_before_the_law_begins_and_the_tip_is_known_as_well(
    name: str, home: bool, tmp_path: Path
) -> None:
    inst = expanded(name)
    load = {"kind": "step-load", "duration": 0.5, "wrench": {"fy": 2.0}}
    errors, path = [], tmp_path / "run.mcap"
    for first in ([], [{"kind": "pretension"}]):
        controller = tn.control.JointController(inst)
        protocol = tn.simulate.Protocol(name="tight", phases=[*first, load])
        run = record(inst, protocol, path, controller=controller, home=home, overwrite=True)
        enabled = run.by_column("operating_state")[:, 0] == tn.control.OperatingState.ENABLED
        off = np.degrees(run["estimated_output_angle"] - run["output_angle"])[enabled]
        errors.append(np.sqrt(np.mean(off**2)))
    slack = run.rows(0, int(np.argmax(enabled)))
    assert slack["tension"].min() == 0
    assert np.isnan(slack["operating_state"][: int(np.argmax(slack["tension"].min(axis=1) > 1))]).all()
    assert not np.nansum(run["faults"])
    assert errors[1] < errors[0] + 0.02
    assert replay(Recording.open(path)).exact


def test_a_recording_tells_the_force_at_the_tip_and_its_table_the_same(tmp_path: Path) -> None:
    load = {"kind": "step-load", "delay": 0.1, "rise": 0.1, "duration": 0.5, "wrench": {"fx": 1.0, "fy": -0.5}}
    path = tmp_path / "run.mcap"
    run = record("needle-driver", tn.simulate.Protocol(name="push", phases=[load]), path)
    tables.to_csv(run, path.with_suffix(".csv"))
    found = observed(path)
    for one in found.channels:
        if one.name != "wrench.fz":  # along a straight tip, to which no joint yields
            assert np.abs(one.recorded - one.value)[-100:].max() < (0.1 if one.unit == "N" else np.radians(0.15))
            assert one.covered > 0.9
    again = observed(path.with_suffix(".csv"), expanded("needle-driver"))
    for one, other in zip(found.channels, again.channels, strict=True):
        np.testing.assert_array_equal(one.value, other.value)
    with refused("instrument", kind=IdentificationError):
        observed(path.with_suffix(".csv"))
    with refused("signals", kind=IdentificationError):
        observed(path, expanded("hybrid-real-size"))


def test_grip_force_is_compared_from_a_recording_as_from_its_table(tmp_path: Path) -> None:
    applied = {"kind": "step-load", "delay": 0.1, "rise": 0.1, "duration": 0.3, "release": 0.1, "grip_force": 1.0}
    closed = {"kind": "ramp", "duration": 0.3, "handle_angles": {"jaw_1": -0.1, "jaw_2": 0.1}}
    phases = [applied, {"kind": "object", "stiffness": "2 N/mm"}, closed, {"kind": "hold", "duration": 0.2}]
    path = tmp_path / "run.mcap"
    run = record("needle-driver", tn.simulate.Protocol(name="grip", phases=phases), path)
    table = path.with_suffix(".csv")
    tables.to_csv(run, table)
    for one in (observed(path), observed(table, expanded("needle-driver"))):
        grip = one.channels[-1]
        assert grip.recorded.max() > 1.0 + 1e-9
        assert run["grip_force"].max() > 0.3
        assert grip.rmse < 0.1
    assert lab_tables.has_headings(path)
    assert lab_tables.has_headings(table)
    spindle = tmp_path / "00.TXT"
    spindle.write_text("%Used left spindle\n0.0,1,2,3\n", "utf-8")
    assert not lab_tables.has_headings(spindle)


@pytest.mark.parametrize(
    ("phases", "key"),
    [
        ([{"kind": "hold", "duration": 0.1}, {"kind": "pretension"}], "phase"),
        ([{"kind": "pretension", "tension": "12 N"}], "tension"),
    ],
)
def test_a_pretension_that_is_no_zero_of_the_spools_is_refused(phases: list[dict], key: str, tmp_path: Path) -> None:
    controller = tn.control.JointController("needle-driver")
    protocol = tn.simulate.Protocol(name="late", phases=phases)
    with refused(key, kind=ProtocolError):
        record("needle-driver", protocol, tmp_path / "run.mcap", controller=controller)


def test_what_does_not_fit_is_refused() -> None:
    controller = tn.control.JointController("needle-driver")
    with refused("period"):
        tn.control.JointController("needle-driver", period=0.0)
    with pytest.raises(ValueError, match="does not fit"):
        controller.step(np.zeros(4), np.zeros(6))
    with refused("law"):
        tn.control.JointController("needle-driver", "robust")
    controller.reset()
    with refused("controller"):
        tn.twin.Twin(expanded("hybrid-real-size")).run(np.zeros((2, 3)), controller=controller)
    planar = tn.twin.Twin("scaled-up")
    with refused("controller"):
        planar.run(np.zeros((2, 1)), controller=tn.control.JointController("scaled-up"))
    with refused("target"):
        planar.run(np.zeros((2, 1)), target=[0.2])
    with refused("target"):
        tn.twin.Twin("needle-driver").run(np.zeros((2, 0)), controller=controller, target=[0.2, 0.3])
