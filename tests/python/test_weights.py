"""Claims about the weights hung on the load rig: nearest, fewest, and never more than there are."""

from collections.abc import Sequence
from itertools import product
from math import inf, nan
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.constants import g

import tenodesis as tn
from tenodesis.errors import DesignError
from tenodesis.instrument import Instrument
from tenodesis.scaling.weights import WeightSelection, least_difference, select_weights

from .conftest import refused


class Weight(NamedTuple):
    mass: float
    count: int  # type: ignore[assignment]
    tolerance: float = 0.0


# OIML R 111: 1, 2, 2, 5 per decade; class M1's tolerances.
SET = (
    Weight(0.01, 1, 0.25e-6),
    Weight(0.02, 2, 0.8e-6),
    Weight(0.05, 3, 3e-6),
    Weight(0.1, 1, 5e-6),
    Weight(0.2, 2, 10e-6),
    Weight(0.5, 1, 25e-6),
    Weight(1.0, 1, 50e-6),
    Weight(2.0, 2, 100e-6),
)


def brute_force(weight: float, weights: Sequence[Weight], cable_mass: float) -> tuple[float, int, int]:
    """Return the least error (N), the fewest pieces that have it, and the fewest that have it but for rounding."""
    sides = product(*[[(a, b) for a in range(n + 1) for b in range(n + 1 - a)] for _, n, _ in weights])
    found = []
    for pairs in sides:
        loading = sum(one.mass * a for one, (a, _) in zip(weights, pairs, strict=True))
        counter = sum(one.mass * b for one, (_, b) in zip(weights, pairs, strict=True))
        if min(loading, counter) >= cable_mass - 1e-12:
            found.append((abs((loading - counter) * g - weight), sum(a + b for a, b in pairs)))
    least = min(error for error, _ in found)
    fewest, nearly = (min(n for error, n in found if error <= least + off) for off in (1e-12, 1e-8))
    return least, fewest, nearly


@settings(max_examples=60, deadline=None)
@given(
    grams=st.lists(st.sampled_from([0.001, 0.05, 1, 3, 7, 10, 20, 20.5, 50, 333.333, 5000]), min_size=1, max_size=4),
    counts=st.lists(st.integers(1, 2), min_size=4, max_size=4),
    weight=st.floats(-12, 12) | st.sampled_from([0.0, 0.01 * g, 0.015 * g, -0.035 * g]),
    share=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_no_other_pieces_come_nearer_nor_are_fewer(
    grams: list[float], counts: list[int], weight: float, share: float
) -> None:
    weights = [Weight(mass * 1e-3, count) for mass, count in zip(grams, counts, strict=False)]
    cable_mass = share * min(one.mass for one in weights)
    if cable_mass and sum(one.count for one in weights) < 2:
        with refused("cable_mass", kind=DesignError):
            select_weights(weight, weights, cable_mass=cable_mass)
        return
    found = select_weights(weight, weights, cable_mass=cable_mass)
    error, fewest, nearly = brute_force(weight, weights, cable_mass)
    assert abs(found.error) == pytest.approx(error, abs=1e-8)
    assert nearly <= found.pieces <= fewest
    for one in weights:
        there = sum(other.count for other in weights if other.mass == one.mass)
        assert (found.loading + found.counter).count(one.mass) <= there


def test_a_positive_weight_makes_the_twin_feel_a_positive_force(scaled: Instrument) -> None:
    rig = scaled.conditions.cable_pulley_radius
    assert rig is not None
    calm = scaled.replace(friction=None, mismatch=None)
    handle = np.full(2000, 0.3)
    found = select_weights(1.5 * scaled.rig_arm / rig, SET, cable_mass=0.05)
    hung, pushed = (
        tn.twin.Twin(calm, quasi_static=True).run(handle, **{kind: value})["output_angle"][-1]
        for kind, value in (("weight", found.weight), ("force", found.weight * rig / scaled.rig_arm))
    )
    assert hung == pytest.approx(pushed, abs=1e-12)
    assert hung < tn.statics.output_angle(calm, 0.3)
    assert sum(found.loading) > sum(found.counter)
    assert found.weight * rig / scaled.rig_arm == pytest.approx(1.5, rel=5e-3)


def test_a_negative_force_is_hung_the_other_way_round() -> None:
    ahead, back = (select_weights(force, SET, cable_mass=0.05) for force in (12.3, -12.3))
    assert (ahead.loading, ahead.counter) == (back.counter, back.loading)
    assert ahead.weight == pytest.approx(-back.weight, rel=1e-14)
    assert (back.wanted, back.difference < 0) == (-12.3, True)


def test_no_force_keeps_both_cables_taut_alike() -> None:
    found = select_weights(0.0, SET, cable_mass=0.05)
    assert (found.loading, found.counter) == ((0.05,), (0.05,))
    assert (found.weight, found.error, found.relative_error) == (0.0, 0.0, 0.0)
    assert found.sentence == "50 g on the loading cable, 50 g on the counter cable: 0 N, as wanted"
    none = select_weights(0.0, SET, cable_mass=0.0)
    assert none.sentence.startswith("nothing on the loading cable, nothing on the counter")


def test_more_than_there_is_gives_all_there_is_and_says_by_how_much_it_falls_short() -> None:
    found = select_weights(100.0, SET, cable_mass=0.05)
    assert sum(found.counter) == pytest.approx(0.05)
    assert sum(found.loading) + 0.05 == pytest.approx(sum(one.mass * one.count for one in SET))
    assert found.error == pytest.approx(found.weight - 100)
    assert found.sentence.endswith(f"{found.weight:.4g} N, {(100 - found.weight):.1f} % less than wanted")


def test_an_error_of_exactly_half_a_step_takes_the_fewer_pieces() -> None:
    """30 g and 20 g are as far from 25 g; 20 g is one piece."""
    found = select_weights(0.025 * g, (Weight(0.01, 1), Weight(0.02, 1)), cable_mass=0.0)
    assert (found.loading, found.counter) == ((0.02,), ())


def test_the_sentence_lists_equal_pieces_and_the_error() -> None:
    found = WeightSelection((2.0, 2.0, 0.05), (0.05,), 39.1, 0.0)
    assert found.sentence == (
        "2 x 2 kg + 50 g on the loading cable, 50 g on the counter cable: 39.23 N, 0.3 % more than wanted"
    )
    assert WeightSelection((0.002,), (0.0005,), 0.0, 0.0).sentence == (
        "2 g on the loading cable, 500 mg on the counter cable: 0.01471 N, 0.0147 N more than wanted"
    )
    assert WeightSelection((), (1.0,), -9.9, 0.0).sentence.endswith("-9.807 N, 0.9 % more than wanted")


def test_tolerances_of_all_pieces_add_up() -> None:
    found = select_weights(2 * g, SET, cable_mass=0.05)
    assert (found.loading, found.counter) == ((2.0, 0.05), (0.05,))
    assert found.tolerance == pytest.approx((100e-6 + 2 * 3e-6) * g)


def test_a_set_from_a_milligram_to_ten_kilograms_is_exact() -> None:
    decades = [10.0**n for n in range(-6, 1)]
    weights = [Weight(round(mass * step, 9), 2 if step == 2 else 1) for mass in decades for step in (1, 2, 5)]
    for mass in (1.234567, 7.654321, 9.999999, 0.000003):
        found = select_weights(mass * g, weights, cable_mass=0.05)
        assert found.difference == pytest.approx(mass, abs=1e-12)


@pytest.mark.parametrize(
    ("grams", "count", "cable_mass", "step"),
    [
        ((1, 2, 5, 10, 20, 50), 2, 0.01, 1),  # the lightest piece
        ((500, 501, 502, 504), 1, 0.05, 1),  # of weights that are all far heavier
        ((20, 50), 1, 0.0, 20),
        ((20, 50), 1, 0.02, 30),  # both hang
        ((20, 50), 2, 0.0, 10),  # 50 against 20 + 20
        ((300, 500.001), 2, 0.3, 99.999),
        ((5000, 4999.999), 1, 4.0, 0.001),
    ],
)
def test_the_finest_difference_is_what_the_pieces_can_make_and_no_less(
    grams: tuple[float, ...], count: int, cable_mass: float, step: float
) -> None:
    weights = [Weight(round(mass * 1e-3, 9), count) for mass in grams]
    assert least_difference(weights, cable_mass) == pytest.approx(step * 1e-3, rel=1e-12)


@settings(max_examples=30, deadline=None)
@given(
    grams=st.lists(st.sampled_from([0.003, 1, 3, 7, 20, 20.5, 333.333, 501, 5000]), min_size=2, max_size=4),
    share=st.sampled_from([0.0, 1.0]),
)
def test_no_pieces_make_less_than_the_finest_difference(grams: list[float], share: float) -> None:
    weights = [Weight(mass * 1e-3, 1) for mass in grams]
    cable_mass = share * min(one.mass for one in weights)
    made = []
    for sides in product((-1, 0, 1), repeat=len(grams)):
        cables = [sum(one.mass for one, at in zip(weights, sides, strict=True) if at == side) for side in (1, -1)]
        if min(cables) >= cable_mass - 1e-12:
            made.append(cables[0] - cables[1])
    above = [difference for difference in made if difference > 1e-9]
    if above:
        assert least_difference(weights, cable_mass) == pytest.approx(min(above), abs=1e-9)
    else:
        with refused("cable_mass", kind=DesignError):
            least_difference(weights, cable_mass)


def test_bad_input_ends_in_one_sentence() -> None:
    for weight in (nan, inf):
        with pytest.raises(ValueError, match=r"weight is (nan|inf); it must be a finite force in N"):
            select_weights(weight, SET, cable_mass=0.05)
    with pytest.raises(ValueError, match=r"cable_mass is -0\.1; it must be a mass of at least 0 kg"):
        select_weights(1.0, SET, cable_mass=-0.1)
    with pytest.raises(ValueError, match=r"cable_mass is nan; it must be a mass of at least 0 kg"):
        least_difference(SET, nan)
    with pytest.raises(
        DesignError, match=r"the weights, 1 kg in all, give no difference between two cables with 0\.5 kg"
    ):
        least_difference((Weight(0.5, 2),), 0.5)
    with pytest.raises(DesignError, match="there are no weights to hang"):
        select_weights(1.0, (), cable_mass=0.05)
    with pytest.raises(DesignError, match=r"the weights, 0\.08 kg in all, do not keep two cables taut with 0\.05 kg"):
        select_weights(1.0, (Weight(0.05, 1), Weight(0.03, 1)), cable_mass=0.05)
    with pytest.raises(DesignError, match="it must be at least 1 mg"):
        select_weights(1.0, (Weight(1e-8, 1),), cable_mass=0.0)
