"""Claims about the similarity error with friction, at rest and in time, and about what causes it."""

from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument

from .conftest import refused
from .similar import FRICTION, geometrically_scaled

FIG_14 = [force / 2.88 for force in (0.5, 1.0, 1.5)]


@pytest.fixture
def rough(any_inst: Instrument) -> Instrument:
    """Every mechanism, with everything that friction has."""
    return any_inst.replace(**FRICTION)


def test_a_geometrically_scaled_instrument_is_similar_with_friction_at_rest_and_in_time(rough: Instrument) -> None:
    comparison = tn.similarity.compare(rough, geometrically_scaled(rough, 2.5))
    rest, cycle = comparison.error_at_rest(), comparison.cycle_error(speed=0.5)
    assert rest.largest < 1e-6
    assert cycle.largest < 1e-6
    assert rest.unsolved == cycle.unsolved == 0
    assert rest.largest_force > 0
    assert np.ptp(cycle.real_size_angle) > 1


def test_without_friction_the_error_at_rest_is_the_frictionless_one(real: Instrument, scaled: Instrument) -> None:
    smooth = [inst.replace(friction=None) for inst in (real, scaled)]
    comparison = tn.similarity.compare(*smooth)
    error = comparison.error_at_rest()
    scaled_up = smooth[1].replace(pretension=error.scaled_up_pretension)
    theirs = tn.statics.output_angle(scaled_up, error.handle_angle, error.force[:, None] * error.force_factor)
    ours = tn.statics.output_angle(real, error.handle_angle, error.force[:, None])
    # Quasi-static steps end at rest to a tolerance of their own, and drag keeps them from being exact.
    assert error.error == pytest.approx(np.degrees(theirs - ours), abs=1e-3)


def test_a_loop_flexes_and_extends_over_the_working_range_and_friction_opens_it(
    real: Instrument, scaled: Instrument
) -> None:
    error = tn.similarity.compare(real, scaled).error_at_rest(forces=[0.0, 0.5])
    reach = tn.statics.reach(real)
    assert error.handle_angle.max() == pytest.approx(reach)
    assert error.handle_angle.min() == pytest.approx(-reach)
    start = int(np.argmax(error.handle_angle))
    extending, flexing = (
        error.real_size_angle[0, start + 1 :][error.flexing[start + 1 :] == way] for way in (False, True)
    )
    width = np.degrees(extending[::-1] - flexing)
    assert np.median(width[5:-5]) > 0.5
    assert error.real_size_angle.shape == error.scaled_up_angle.shape == error.error.shape == (2, error.time.size)


def test_a_slow_cycle_in_time_agrees_with_the_loops_at_rest(real: Instrument, scaled: Instrument) -> None:
    comparison = tn.similarity.compare(real, scaled)
    rest, cycle = comparison.error_at_rest(forces=FIG_14), comparison.cycle_error(forces=FIG_14)
    assert cycle.rms == pytest.approx(rest.rms, rel=0.1)
    assert np.diff(cycle.time) == pytest.approx(5e-4)
    assert cycle.time_factor == pytest.approx(4.4, abs=0.01)


def test_the_error_with_friction_of_the_papers_pair(real: Instrument, scaled: Instrument) -> None:
    """Our own numbers, so that none of them moves unnoticed: at Fig. 14's loads, pretension scaled and as used."""
    comparison = tn.similarity.compare(real, scaled)
    similar, used = (comparison.error_at_rest(forces=FIG_14, pretension=pretension) for pretension in (None, 25.0))
    assert (similar.largest, used.largest) == pytest.approx((0.26, 2.74), abs=0.01)
    assert similar.largest_force == used.largest_force == FIG_14[-1]
    place = used.worst
    row = int(np.flatnonzero(used.force == place.force)[0])
    column = np.flatnonzero((used.handle_angle == place.handle_angle) & (used.flexing == place.flexing))
    assert np.abs(used.error[row, column]).max() == used.largest
    cycled = comparison.cycle_error(forces=FIG_14, pretension=25.0)
    assert cycled.largest == pytest.approx(2.85, abs=0.02)


def test_the_default_forces_go_as_far_as_both_hold(real: Instrument, scaled: Instrument) -> None:
    comparison = tn.similarity.compare(real, scaled)
    error = comparison.error_at_rest()
    assert error.unsolved == 0
    assert error.force[0] == 0
    assert 0.5 < error.largest_force < comparison.largest_force
    beyond = comparison.error_at_rest(forces=[0.5, comparison.largest_force])
    assert 0 < beyond.unsolved < 1
    assert beyond.largest_force == 0.5
    assert 0 <= beyond.held_by_one < beyond.unsolved


def test_a_design_is_judged_by_its_file_not_by_its_mismatch(real: Instrument, scaled: Instrument) -> None:
    assert scaled.mismatch.stiffness_ratio != 1
    bare = scaled.replace(mismatch=None, **{"dynamics.hand_stiffness": 20.0})
    ours, theirs = (tn.similarity.compare(real, inst).error_at_rest(forces=[0.3]).error for inst in (scaled, bare))
    assert np.array_equal(ours, theirs)


def test_different_mechanisms_are_compared_with_friction_too(real: Instrument, pulley: Instrument) -> None:
    rough = pulley.replace(friction=real.friction)
    comparison = tn.similarity.compare(real, rough)
    rest = comparison.error_at_rest(forces=[0.0, 0.2])
    assert rest.unsolved == 0
    assert rest.rms < 1
    assert comparison.cycle_error(forces=[0.2], speed=0.5).rms < 1
    causes = comparison.causes(friction=True, forces=[0.0, 0.2])
    assert causes["mu"].rms == 0
    assert causes["joint type"].rms > 0


@pytest.mark.parametrize("argument", [{"forces": []}, {"forces": [np.nan]}, {"forces": [[1.0]]}])
def test_forces_that_are_none_are_refused(real: Instrument, argument: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="forces is"):
        tn.similarity.compare(real, real).error_at_rest(**argument)


def test_a_cycle_needs_a_speed(real: Instrument) -> None:
    with refused("speed", 0):
        tn.similarity.compare(real, real).cycle_error(speed=0)


def _lengthened(inst: Instrument, share: float) -> dict[str, Any]:
    """Return changes that make the joints a smaller share of the tendon, all else kept."""
    length = inst.tendon_length or inst.overall_length
    return {
        "tendon_length": length * (1 + share),
        "handle_length": inst.handle_length * (1 + share),
        "tendon_stiffness": inst.tendon_stiffness,
    }


CHANGES: dict[str, Any] = {
    "mu": lambda inst, share: {"friction.vertex_coefficient": inst.friction.vertex_coefficient * (1 + share)},
    "mu_s": lambda inst, share: {"friction.sheath_coefficient": inst.friction.sheath_coefficient * (1 + share)},
    "phi_s": lambda inst, share: {"friction.sheath_bend": inst.friction.sheath_bend * (1 + share)},
    "dphi_s/dtheta_h": lambda inst, share: {
        "friction.sheath_bend_per_handle_angle": inst.friction.sheath_bend_per_handle_angle * (1 + share)
    },
    "f_c/(kr)": lambda inst, share: {"friction.constant": inst.friction.constant * (1 + share)},
    "handle share": lambda inst, share: {"handle_length": inst.handle_length * (1 + share)},
    "distal joint share": _lengthened,
}


@pytest.mark.parametrize("name", CHANGES)
def test_an_error_of_one_group_of_friction_is_put_down_to_that_group(rough: Instrument, name: str) -> None:
    inst = rough.replace(**{"friction.law": "capstan-constant", "friction.static_ratio": None})
    scaled_up = inst.replace(**CHANGES[name](inst, 0.1))
    reported: list[tuple[float, float]] = []
    force = 0.1 * float(tn.statics.slack_force(inst, 0.0))
    comparison = tn.similarity.compare(inst, scaled_up)
    causes = comparison.causes(
        friction=True, forces=[0.0, force], progress=lambda done, total: reported.append((done, total))
    )
    assert causes.worst == name
    assert causes.remainder_rms < 0.02 * causes.error_rms
    assert all(cause.rms == 0 for cause in causes.causes if cause.name != name)
    assert reported[-1][0] == reported[-1][1]


def test_causes_with_friction_add_up_to_the_error_of_the_papers_pair(real: Instrument, scaled: Instrument) -> None:
    comparison = tn.similarity.compare(real, scaled)
    similar = comparison.causes(friction=True, forces=FIG_14)
    assert similar.worst == "handle share"
    assert similar.remainder_rms < 0.01 * similar.error_rms
    used = comparison.causes(friction=True, forces=FIG_14, pretension=25.0)
    assert used.worst == "T_o/(kr)"
    assert used.remainder_rms < 0.02 * used.error_rms


def test_friction_laws_may_differ_and_what_the_richer_one_adds_is_a_cause(scaled: Instrument) -> None:
    stribeck = scaled.replace(**{"friction.law": "stribeck", "friction.static_ratio": 1.4})
    for pair in ((scaled, stribeck), (stribeck, scaled)):
        causes = tn.similarity.compare(*pair).causes(friction=True, forces=[0.5])
        assert causes.worst == "mu_0/mu"
        assert causes.remainder_rms < 0.1 * causes.error_rms
    smooth = scaled.replace(friction=None)
    causes = tn.similarity.compare(smooth, scaled).causes(friction=True, forces=[0.5])
    assert causes.worst == "mu"
    assert causes["mu_s"].rms > 0
