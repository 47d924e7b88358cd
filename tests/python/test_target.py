"""The target of every law: the elastic instrument without load and friction; a backbone bends it less than eq. 18."""

import numpy as np
import pytest
from scipy.optimize import brentq

import tenodesis as tn
from tenodesis import simulate
from tenodesis.control import Controller, OperatingState
from tenodesis.control.derived import derive
from tenodesis.instrument import Continuum, Instrument, TendonGear, TendonPulley
from tenodesis.recording.summary import tip_error
from tenodesis.run import Run
from tenodesis.simulate import Protocol, StepLoad
from tenodesis.statics.stroke import settled_stroke, wound
from tenodesis.twin import Twin


@pytest.fixture
def stiff(continuum: Continuum) -> Continuum:
    """An endoscope's tip, whose backbone takes half of the angle and slackens the antagonist from 38 deg on."""
    return continuum.replace(
        name="stiff backbone",
        overall_length="700 mm",
        distal_tendon_offset="2.2 mm",
        proximal_pulley_radius="5 mm",
        backbone_length="40 mm",
        backbone_rigidity="0.004 N*m^2",
        end_effector_length="8 mm",
        tendon_diameter="0.45 mm",
        tendon_modulus="54.2 GPa",
        pretension="15 N",
        handle_range="62 deg",
        output_range="60 deg",
        friction={"law": "capstan", "vertex_coefficient": 0.1, "sheath_coefficient": 0.1, "sheath_bend": "10 deg"},
        dynamics={"tip_inertia": "5.48e-06 kg*m^2"},
        drives={"spool_radius": "5 mm", "motor_speed": "1200 deg/s"},
        sensors={"load_cell_range": "100 N"},
    )


def limit(inst: Instrument) -> float:
    """The limit that `check` prints, N."""
    return next(one.value for one in derive(inst) if one.key == "tension_limit")


def pushed(inst: Instrument, angle: float, law: str = "robust") -> Run:
    """Hold the tip at an angle (deg), push it with 1 N for 2 s, and let it return for 3 s."""
    push = StepLoad(output_angle=np.radians(angle), delay=0.5, force=1.0, duration=2.0, release=3.0)
    return simulate.execute(Twin(inst), Protocol(name="push", phases=(push,)), Controller(inst, law=law))


# ---- where it is


@pytest.mark.equation(18)
def test_without_a_backbone_the_target_is_eq_18(real: TendonGear, pulley: TendonPulley) -> None:
    handle = np.linspace(-0.6, 0.6, 13)
    ratio = real.proximal_gear_radius / real.distal_gear_radius
    assert tn.statics.unloaded_angle(real, handle) == pytest.approx(
        2 * np.arcsin(ratio * np.sin(handle / 2)), abs=1e-15
    )
    ratio = pulley.proximal_pulley_radius / pulley.distal_pulley_radius
    assert tn.statics.unloaded_angle(pulley, handle) == pytest.approx(ratio * handle, abs=1e-15)


def test_the_target_is_where_the_unloaded_statics_are(any_inst: Instrument, stiff: Instrument) -> None:
    for inst in (any_inst, stiff):
        handle = np.linspace(-inst.handle_range, inst.handle_range, 25)
        assert tn.statics.unloaded_angle(inst, handle) == pytest.approx(
            tn.statics.output_angle(inst, handle), abs=1e-12
        )


@pytest.mark.parametrize("handle", [-62, -50, -20, 5, 30, 45, 62])
def test_at_the_target_backbone_and_tendons_balance_slack_included(stiff: Continuum, handle: float) -> None:
    r, k, spring = stiff.distal_tendon_offset, stiff.tendon_stiffness, stiff.backbone_rigidity / stiff.backbone_length
    drawn = stiff.proximal_pulley_radius * np.radians(handle)

    def moment(angle: float) -> float:
        stretch = k * (drawn - r * angle)
        return r * (max(stiff.pretension + stretch, 0) - max(stiff.pretension - stretch, 0)) - spring * angle

    found = float(tn.statics.unloaded_angle(stiff, np.radians(handle)))
    assert found == pytest.approx(brentq(moment, -2, 2, xtol=1e-14), abs=1e-12)
    tensions = tn.statics.tensions(stiff, np.radians(handle))
    assert (min(tensions) == 0) == (abs(found) > np.radians(37.8153))


def test_targets_are_those_of_every_axis_and_keep_what_is_not_known(real: Instrument) -> None:
    handle = np.array([[-0.4, 0.3], [np.nan, 0.2], [10.0, -10.0]])
    found = tn.statics.targets(real, handle)
    assert np.isnan(found[1]).all()
    assert tn.statics.targets(real, handle[0]) == pytest.approx(found[0])
    assert tn.statics.targets(real.axis("yaw"), handle[0, :1]) == pytest.approx(found[0, :1])
    for n, axis in enumerate(real.axes):
        alone, ends = real.axis(axis), [1, -1][n] * real.handle_range
        assert found[0, n] == pytest.approx(tn.statics.unloaded_angle(alone, handle[0, n]), abs=1e-12)
        assert found[2, n] == pytest.approx(tn.statics.unloaded_angle(alone, ends), abs=1e-12)


# ---- the strokes that lead back to it


@pytest.mark.equation(22)
@pytest.mark.parametrize("actuation", ["agonist", "differential"])
@pytest.mark.parametrize("force", [-0.5, 0.4, 1.0, 2.0])
def test_exact_strokes_restore_the_unloaded_angle(
    any_inst: Instrument, stiff: Instrument, actuation: str, force: float
) -> None:
    for inst in (any_inst, stiff):
        handle = np.linspace(-0.9, 0.9, 13) * inst.handle_range
        stroke = settled_stroke(inst, handle, force, actuation, "exact")
        solved = np.isfinite(stroke)
        back = tn.statics.output_angle(inst, handle[solved], force, wound=wound(stroke[solved], actuation))
        assert back == pytest.approx(tn.statics.unloaded_angle(inst, handle[solved]), abs=1e-9)
        # One motor can let out no more than until its tendon hangs.
        assert solved.all() or actuation == "agonist" or any_inst.joint_type == "tendon-gear"


def test_no_load_needs_no_stroke(any_inst: Instrument, stiff: Instrument) -> None:
    for inst in (any_inst, stiff):
        for share in (-0.9, -0.5, 0.0, 0.3, 0.95):
            handle = share * inst.handle_range
            tensions = tn.statics.tensions(inst, handle)
            for actuation in ("agonist", "differential"):
                for law in ("exact", "paper"):
                    stroke = tn.statics.compensation_stroke(inst, *tensions, actuation, law, handle_angle=handle)
                    assert stroke == pytest.approx(0, abs=1e-12)


# ---- the laws


@pytest.mark.parametrize("angle", [20, 55])
def test_a_pushed_tip_returns_to_its_unloaded_angle_and_no_tendon_exceeds_its_limit(
    stiff: Instrument, angle: float
) -> None:
    run = pushed(stiff, angle)
    assert run["operating_state"].max() == OperatingState.ENABLED
    error = np.degrees(tip_error(run, stiff)[:, 0])
    loaded = np.flatnonzero(run["force"] > 0.99)
    assert abs(np.degrees(tn.statics.unloaded_angle(stiff, run["handle_angle"][-1])) - angle) < 1e-6
    assert np.abs(error[loaded[-1000:]]).max() < 0.3
    assert abs(error[-1]) < 0.3
    assert run["tension"].max() <= limit(stiff)


def test_a_tendon_that_the_hand_pulls_to_its_limit_is_let_out(stiff: Continuum) -> None:
    """A load that is compensated at 30 deg would take the tendon to 85 N at the end of the handle's range."""
    time = np.arange(1, 14001) * 5e-4
    rise = [np.clip((time - start) / 2, 0, 1) for start in (0, 4)]
    bend = sum(by * s**3 * (10 - 15 * s + 6 * s**2) for by, s in zip(np.radians([30, 30]), rise, strict=True))
    run = Twin(stiff, seed=1).run(bend, np.where(time > 2.5, 1.5, 0.0), controller=Controller(stiff))
    assert run["operating_state"].max() == OperatingState.ENABLED
    assert run["tension"].max() > 0.95 * limit(stiff)
    assert run["tension"].max() <= limit(stiff)
