"""The same properties over every mechanism, searched for counterexamples by hypothesis."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tenodesis as tn
from tenodesis.instrument import JOINT_TYPES, Continuum, Instrument, TendonGear, TendonPulley
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
many = settings(max_examples=200)


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
def test_without_force_tendons_hold_nothing_but_the_backbone(inst: Instrument, handle: float) -> None:
    tension = tn.statics.tensions(inst, handle)
    if isinstance(inst, Continuum):
        backbone = inst.backbone_rigidity / inst.backbone_length * tn.statics.output_angle(inst, handle)
        moment = (tension.agonist - tension.antagonist) * inst.distal_tendon_offset
        assert moment == pytest.approx(backbone, rel=1e-9, abs=1e-9)
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


# In shares of the proximal radius: half of what a handle at its range draws, out or in.
strokes = st.floats(-0.3, 0.3)
# In shares of the force above; a real one would rarely exceed it by more.
radials = st.floats(-5, 5)


def loading(inst: Instrument, radial: float, first: float, second: float) -> dict[str, Any]:
    """Radial force and motor strokes, from shares of the unit force and of the proximal radius."""
    radius = next(value for key, value, _ in inst.quantities() if key.startswith("proximal"))
    return {"radial_force": radial * unit_force(inst), "wound": (first * radius, second * radius)}


@many
@given(instruments(), handles, loads, radials, strokes, strokes)
def test_output_angle_and_handle_angle_are_inverse(
    inst: Instrument, handle: float, load: float, radial: float, first: float, second: float
) -> None:
    unit = unit_force(inst)
    more = loading(inst, radial, first, second)
    state = tn.statics.equilibrium(inst, handle, load * unit, **more)
    if state.status != Status.OK or max(state.agonist, state.antagonist) < 1e-9:
        return  # nothing holds the tip, so that its angle does not depend on the handle's
    slope = tn.statics.gradient("output_angle", inst, handle, load * unit, wrt=["handle_angle"], **more)
    found = tn.statics.handle_angle(inst, np.array([state.output_angle]), load * unit, **more)
    beside = np.clip([handle - 1e-7, handle + 1e-7], -inst.handle_range, inst.handle_range)
    if not abs(slope["handle_angle"]) < 1e3 or tn.statics.equilibrium(inst, beside, load * unit, **more).status.any():
        return  # within rounding of the fold, or of where both tendons go slack and nothing holds the tip
    back = tn.statics.equilibrium(inst, found, load * unit, **more)
    assert back.output_angle[0] == pytest.approx(state.output_angle, abs=1e-10 * max(1.0, slope["handle_angle"]))


@many
@given(instruments(), handles, loads, radials, strokes, strokes)
def test_what_is_called_solved_is_in_balance(
    inst: Instrument, handle: float, load: float, radial: float, first: float, second: float
) -> None:
    """The load that the tensions at the solution hold, by the slope of the energy, is the load that was given."""
    unit = unit_force(inst)
    state = tn.statics.equilibrium(inst, handle, load * unit, **loading(inst, radial, first, second))
    if state.status != Status.OK:
        return
    output = state.output_angle
    lever = tn.statics.loss_of_dexterity(inst, output, 1.0) * tn.statics.flexural_stiffness(inst, output)
    if isinstance(inst, TendonGear):
        arm, spring = inst.distal_gear_radius * np.cos(output / 2), 0.0
        radial_arm = inst.distal_gear_radius * np.sin(output / 2)
    elif isinstance(inst, Continuum):
        arm, spring = inst.distal_tendon_offset, inst.backbone_rigidity / inst.backbone_length
        bow = (output - np.sin(output)) / output**2 if abs(output) > 1e-3 else output / 6
        radial_arm = inst.backbone_length * bow
    else:
        assert isinstance(inst, TendonPulley)
        arm, spring, radial_arm = inst.distal_pulley_radius, 0.0, 0.0
    held = (state.agonist - state.antagonist) * arm - spring * output
    asked = (load * lever - radial * radial_arm) * unit
    scale = inst.tendon_stiffness * arm**2 + spring
    assert held == pytest.approx(asked, abs=1e-9 * scale + 1e-7 * abs(asked))
