"""The same properties over every mechanism, searched for counterexamples by hypothesis."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import tenodesis as tn
from tenodesis.instrument import JOINT_TYPES, Instrument
from tenodesis.statics import Status


@st.composite
def instruments(draw: st.DrawFn) -> Instrument:
    """Any instrument a person could build, of any mechanism."""
    joint_type = draw(st.sampled_from(sorted(JOINT_TYPES)))
    between = lambda low, high: draw(st.floats(low, high))
    distal = between(1e-3, 2e-2)
    values: dict[str, Any] = {
        "name": "drawn",
        "joint_type": joint_type,
        "overall_length": between(0.2, 1.5),
        "end_effector_length": between(5e-3, 0.1),
        "handle_length": between(0.05, 0.2),
        "tendon_diameter": between(2e-4, 1e-3),
        "tendon_modulus": between(2e10, 2e11),
        "pretension": between(0.0, 60.0),
        "handle_range": 0.6,
    }
    # Ratios up to three keep the unloaded joint within reach over the handle's range.
    proximal = distal * between(0.8, 3.0)
    if joint_type == "tendon-gear":
        values |= {"distal_gear_radius": distal, "proximal_gear_radius": proximal}
    elif joint_type == "tendon-pulley":
        values |= {"distal_pulley_radius": distal, "proximal_pulley_radius": proximal}
    else:
        values |= {"distal_tendon_offset": distal, "proximal_pulley_radius": proximal}
        values |= {"backbone_length": between(5e-3, 0.1), "backbone_rigidity": between(1e-5, 1e-2)}
    return JOINT_TYPES[joint_type].model_validate(values)


handles = st.floats(-0.6, 0.6)
# In shares of the force that stretches a tendon by a tenth of the radius, so that loads suit the instrument.
loads = st.floats(-1.5, 1.5)
many = settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def unit_force(inst: Instrument) -> float:
    return float(0.1 / tn.statics.loss_of_dexterity(inst, 0.0, 1.0))


@many
@given(instruments(), handles, loads, st.floats(-0.5, 0.5))
def test_turning_everything_round_turns_the_tip_round(
    inst: Instrument, handle: float, load: float, radial: float
) -> None:
    force = load * unit_force(inst)
    there = tn.statics.equilibrium(inst, handle, force, radial_force=radial * unit_force(inst))
    back = tn.statics.equilibrium(inst, -handle, -force, radial_force=radial * unit_force(inst))
    assert there.status == back.status
    if there.status == Status.OK:
        assert there.output_angle == pytest.approx(-back.output_angle, abs=1e-10)
        assert there.agonist == pytest.approx(back.antagonist, abs=1e-7)


@many
@given(instruments(), loads)
def test_the_tip_follows_the_handle(inst: Instrument, load: float) -> None:
    handle = np.linspace(-0.6, 0.6, 61)
    output = tn.statics.output_angle(inst, handle, load * unit_force(inst))
    steps = np.diff(output[np.isfinite(output)])
    assert (steps > 0).all()


@many
@given(instruments(), handles)
def test_more_load_never_gives_more_angle(inst: Instrument, handle: float) -> None:
    force = np.linspace(-1.5, 1.5, 61) * unit_force(inst)
    output = tn.statics.output_angle(inst, handle, force)
    steps = np.diff(output[np.isfinite(output)])
    assert (steps < 1e-12).all()


@many
@given(instruments(), handles)
def test_without_force_and_spring_the_tip_stands_where_no_tendon_stretches(inst: Instrument, handle: float) -> None:
    tension = tn.statics.tensions(inst, handle)
    if inst.joint_type == "continuum":
        assert abs(tension.agonist - tension.antagonist) > 0 or handle == 0 or abs(handle) < 1e-9
    else:
        assert tension.agonist == pytest.approx(inst.pretension, abs=1e-8)
        assert tension.antagonist == pytest.approx(inst.pretension, abs=1e-8)


@many
@given(instruments(), handles)
def test_angle_and_tension_are_continuous_across_slack(inst: Instrument, handle: float) -> None:
    force = np.linspace(0.0, 2.0, 4001) * max(float(tn.statics.slack_force(inst, 0.0)), unit_force(inst) * 1e-3)
    state = tn.statics.equilibrium(inst, handle, force)
    solved = np.isfinite(state.output_angle)
    taut = state.antagonist[solved] > 0
    if taut.all() or not taut.any():
        return
    at = int(np.flatnonzero(~taut)[0])
    if at < 3 or at + 3 >= solved.sum():
        return
    for values in (state.output_angle[solved], state.agonist[solved]):
        jump = abs(values[at] - values[at - 1])
        around = max(abs(values[at + 2] - values[at + 1]), abs(values[at - 2] - values[at - 3]))
        assert jump <= 3 * around + 1e-9


@many
@given(instruments(), handles, loads)
def test_tensions_never_push_and_the_estimate_recovers_the_tip(inst: Instrument, handle: float, load: float) -> None:
    state = tn.statics.equilibrium(inst, handle, load * unit_force(inst))
    if state.status != Status.OK:
        return
    assert state.agonist >= 0
    assert state.antagonist >= 0
    if state.agonist > 1e-9 and (state.antagonist == 0 or state.antagonist > 1e-9):
        estimate = tn.statics.estimate_output_angle(inst, handle, state.agonist, state.antagonist)
        assert estimate == pytest.approx(state.output_angle, abs=1e-7)


@many
@given(instruments(), handles, loads)
def test_output_angle_and_handle_angle_are_inverse(inst: Instrument, handle: float, load: float) -> None:
    force = load * unit_force(inst)
    state = tn.statics.equilibrium(inst, handle, force)
    if state.status != Status.OK or (state.agonist == 0 and state.antagonist == 0):
        return
    sensitivity = tn.statics.gradient("output_angle", inst, handle, force, wrt=["handle_angle"])["handle_angle"]
    back = tn.statics.equilibrium(inst, tn.statics.handle_angle(inst, state.output_angle, force), force)
    # Close to the fold the tip turns far for nothing, and rounding with it.
    assert back.output_angle == pytest.approx(state.output_angle, abs=1e-10 * max(1.0, sensitivity))
