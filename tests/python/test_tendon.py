"""Claims about one tendon with friction: closed forms, and convergence to the continuous sheath."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tenodesis.errors import ArgumentError
from tenodesis.run import Array
from tenodesis.tendon import Tendon, transmit

from .conftest import refused

STIFFNESS = 3e4  # N/m
PRETENSION = 20.0  # N


def test_sliding_contact_transmits_the_capstan_ratio_and_a_sticking_one_nothing() -> None:
    ratio = math.exp(0.4)
    up = np.linspace(10, 100, 50)
    down = np.linspace(100, 1, 200)
    distal = transmit(np.concatenate([up, down]), 0.4, gain=0.8, initial=10) / 0.8
    assert distal[:50] == pytest.approx(np.maximum(up / ratio, 10), rel=1e-12)
    held = 100 / ratio
    assert distal[50:] == pytest.approx(np.minimum(down * ratio, held), rel=1e-12)
    assert (distal[50:][down * ratio > held * (1 + 1e-9)] == distal[49]).all()


def test_without_friction_a_contact_transmits_everything_and_a_push_counts_as_slack() -> None:
    tension = np.array([3.0, 8.0, -1.0, 2.0])
    assert transmit(tension, 0.0) == pytest.approx([3, 8, 0, 2], abs=0)
    assert transmit([], 0.3).size == 0


def test_pulled_tendon_slides_at_the_product_of_its_contacts_ratios() -> None:
    tendon = Tendon(STIFFNESS, [0.1, 0.2, 0.3], pretension=PRETENSION)
    pull = tendon.pull(np.linspace(PRETENSION, 100, 400))
    assert pull.distal[-1] * math.exp(0.6) == pytest.approx(100, rel=1e-9)
    assert tendon.tensions[1] * math.exp(0.1) == pytest.approx(100, rel=1e-9)
    back = tendon.pull(np.linspace(100, 10, 400))
    assert back.distal[-1] == pytest.approx(10 * math.exp(0.6), rel=1e-9)
    assert (np.diff(back.distal) <= 1e-12).all()


def test_frictionless_tendon_at_rest_is_one_spring() -> None:
    tendon = Tendon([1e5, 2e5, 3e5], [0.0, 0.0], pretension=PRETENSION)
    stiffness = 1 / (1 / 1e5 + 1 / 2e5 + 1 / 3e5)
    for wound, drawn in ((1e-3, 0.0), (2e-3, 1e-4), (-2e-4, 0.0)):
        pull = tendon.wind(np.full(4, wound), drawn)
        expected = PRETENSION + stiffness * (wound + drawn)
        assert tendon.tensions == pytest.approx(expected, rel=1e-12)
        assert pull.distal[-1] == pytest.approx(expected, rel=1e-12)


# --- the continuous sheath ---------------------------------------------------------------------------------------
#
# A tendon of compliance 1/k and friction exponent Y, both spread evenly along s from 0 (spool) to 1 (held far end), was
# everywhere at T0. Pulled, it slides toward the spool as far as a front: T(s) = T_in e^(-Y s) up to where that is T0,
# T0 beyond. What is wound in is the added stretch, the integral of (T - T0)/k over s.


def continuous_pull(tension_in: Array, exponent: float) -> tuple[Array, Array]:
    """Distal tension and wound length of the continuous sheath, pulled from rest."""
    front = np.minimum(np.log(tension_in / PRETENSION), exponent)
    wound = (tension_in * (1 - np.exp(-front)) - PRETENSION * front) / (STIFFNESS * exponent)
    return np.maximum(tension_in * math.exp(-exponent), PRETENSION), wound


def continuous_release(most: float, tension_in: Array, exponent: float) -> tuple[Array, Array]:
    """Distal tension and wound length on the way back from a pull that has reached the far end.

    From the spool on, T(s) = T_in e^(Y s) up to where that meets most e^(-Y s): a front at half the logarithm of the
    ratio, and all of it from T_in = most e^(-2 Y) down.
    """
    front = np.minimum(np.log(most / tension_in) / 2, exponent)
    held = most * (np.exp(-front) - math.exp(-exponent))
    slid = tension_in * (np.exp(front) - 1)
    wound = ((held + slid) - PRETENSION * exponent) / (STIFFNESS * exponent)
    return np.where(front < exponent, most * math.exp(-exponent), tension_in * math.exp(exponent)), wound


def sheath_error(contacts: int, exponent: float) -> tuple[float, float]:
    """Worst error of the wound length on a pull and its release, as a share of its most, and of the distal tension (N).

    The latter beyond what the core's least drag, 1e-9 of a segment's stiffness per contact, comes to.
    """
    most = PRETENSION * math.exp(2 * exponent)
    up = np.linspace(PRETENSION, most, 200)
    down = np.linspace(most, most * math.exp(-3 * exponent), 200)
    tendon = Tendon(STIFFNESS, [exponent / contacts] * contacts, pretension=PRETENSION)
    pulled, released = tendon.pull(up), tendon.pull(down)
    distal_up, wound_up = continuous_pull(up, exponent)
    distal_down, wound_down = continuous_release(most, down, exponent)
    wound = np.concatenate([pulled.wound - wound_up, released.wound - wound_down])
    distal = np.concatenate([pulled.distal - distal_up, released.distal - distal_down])
    step = max(np.abs(np.diff(path)).max() for path in (pulled.wound, released.wound))
    drag = contacts * 1e-9 * STIFFNESS * (contacts + 1) * step * math.exp(exponent)
    return float(np.abs(wound).max() / wound_up.max()), float(np.abs(distal).max() - drag)


def test_continuous_closed_form_is_the_one_of_the_slip_front() -> None:
    y = 0.3
    wound = continuous_pull(np.array([PRETENSION * math.exp(y)]), 0.8)[1][0]
    assert wound == pytest.approx(PRETENSION / (STIFFNESS * 0.8) * (math.exp(y) - 1 - y), rel=1e-12)
    end = continuous_release(50.0, np.array([50.0]), 0.8)
    start = continuous_pull(np.array([50.0]), 0.8)
    assert end[0] == pytest.approx(start[0])
    assert end[1] == pytest.approx(start[1])


@pytest.mark.parametrize("exponent", [0.3, 0.8])
def test_sheath_of_contacts_converges_to_the_continuous_one_in_first_order_or_better(exponent: float) -> None:
    counts = [4, 8, 16, 32, 64]
    errors = [sheath_error(count, exponent) for count in counts]
    wound = [error[0] for error in errors]
    orders = [math.log2(coarse / fine) for coarse, fine in itertools.pairwise(wound)]
    print(f"exponent {exponent}: errors {wound}, orders {orders}")
    assert min(orders) >= 0.95
    assert wound[-1] < 0.01
    # What comes out at the far end does not depend on how many contacts share the exponent.
    assert max(error[1] for error in errors) < 1e-9 * PRETENSION


def test_wound_and_pulled_tendons_agree() -> None:
    exponents = [0.2, 0.1, 0.3]
    up = np.concatenate([np.linspace(20, 80, 100), np.linspace(80, 5, 100), np.linspace(5, 60, 100)])
    pulled = Tendon(STIFFNESS, exponents, pretension=PRETENSION).pull(up)
    wound = Tendon(STIFFNESS, exponents, pretension=PRETENSION).wind(pulled.wound)
    assert wound.proximal == pytest.approx(up, rel=1e-6)
    assert wound.distal == pytest.approx(pulled.distal, rel=1e-6)


# --- any motion --------------------------------------------------------------------------------------------------

exponents_of = st.lists(st.floats(0, 1.5) | st.just(0.0), min_size=1, max_size=6)
steps_of = st.lists(st.tuples(st.floats(-1e-3, 1e-3), st.floats(-2e-4, 2e-4)), min_size=1, max_size=40)


def wandering(steps: list[tuple[float, float]], fine: int) -> tuple[Array, Array]:
    corners = np.cumsum([(0.0, 0.0), *steps], axis=0)
    at = np.linspace(0, len(steps), fine * len(steps) + 1)[1:]
    wound, drawn = (np.interp(at, np.arange(len(corners)), corners[:, k]) for k in (0, 1))
    return np.clip(wound, -2e-3, 3e-3), np.clip(drawn, -5e-4, 5e-4)


@given(exponents_of, steps_of, st.sampled_from([0.0, 0.5]), st.sampled_from([0.0, 30.0]), st.sampled_from([1, 10]))
def test_any_motion_keeps_the_law_and_never_gains_energy(
    exponents: list[float], steps: list[tuple[float, float]], constant: float, viscous: float, fine: int
) -> None:
    wound, drawn = wandering(steps, fine)
    tendon = Tendon(STIFFNESS, exponents, constant=constant, viscous=viscous, pretension=PRETENSION)
    pull = tendon.wind(wound, drawn)
    scale = max(PRETENSION, float(pull.proximal.max()), float(pull.distal.max()))
    assert all(np.isfinite(column).all() for column in pull)
    assert (pull.proximal >= 0).all()
    assert (pull.distal >= 0).all()
    assert pull.residual.max() <= 1e-9 * scale
    assert pull.dissipated.min() >= -1e-12 * scale * 1e-3  # rounding over the longest step, 1 mm
    assert tendon.most_sweeps <= 96 + 16 * tendon.slips.size
    assert pull.wound == pytest.approx(wound, abs=0)


@given(exponents_of, steps_of)
def test_state_between_calls_makes_one_motion_of_two(exponents: list[float], steps: list[tuple[float, float]]) -> None:
    wound, drawn = wandering(steps, 2)
    together = Tendon(STIFFNESS, exponents, pretension=PRETENSION)
    at_once = together.wind(wound, drawn)
    parted = Tendon(STIFFNESS, exponents, pretension=PRETENSION)
    half = len(wound) // 2
    parts = [parted.wind(wound[part], drawn[part]) for part in (slice(None, half), slice(half, None))]
    for column, *pieces in zip(at_once, *parts, strict=True):
        assert (np.concatenate(pieces) == column).all()
    assert (together.tensions == parted.tensions).all()
    assert (together.slips == parted.slips).all()


@pytest.mark.parametrize("exponents", [[0.3], [0.1, 0.4, 0.2], [0.05] * 12])
@pytest.mark.parametrize("constant", [0.0, 0.4])
def test_tendon_goes_slack_and_tightens_without_chatter(exponents: list[float], constant: float) -> None:
    tendon = Tendon(STIFFNESS, exponents, constant=constant, pretension=PRETENSION)
    path = np.linspace(0, -2e-3, 700)
    slackening, tightening = tendon.wind(path), tendon.wind(path[::-1] * 2 + 2e-3)
    for column in (slackening.proximal, slackening.distal):
        assert np.diff(column).max() <= 1e-9
    for column in (tightening.proximal, tightening.distal):
        assert np.diff(column).min() >= -1e-9
    assert slackening.proximal[-1] == 0
    assert tightening.proximal[-1] > PRETENSION
    if constant == 0:
        assert slackening.distal[-1] == 0


# --- bad input ---------------------------------------------------------------------------------------------------


def test_bad_input_is_named() -> None:
    bad = float("nan")
    tendon = Tendon(STIFFNESS, [0.1], pretension=PRETENSION)
    calls: list[tuple[Callable[[], Any], str, Any]] = [
        (lambda: transmit([1.0], -0.1), "exponent", -0.1),
        (lambda: transmit([1.0, bad], 0.1), "tension[1]", bad),
        (lambda: transmit(np.ones((1, 2)), 0.1), "tension", (1, 2)),
        (lambda: transmit([1.0], 0.1, gain=0.0), "gain", 0.0),
        (lambda: transmit([1.0], 0.1, initial=-1.0), "initial", -1.0),
        (lambda: transmit([1.0], 0.1, initial=bad), "initial", bad),
        (lambda: Tendon(STIFFNESS, [0.1, -0.2]), "exponents[1]", -0.2),
        (lambda: Tendon(STIFFNESS, [0.1, bad]), "exponents[1]", bad),
        (lambda: Tendon(STIFFNESS, []), "exponents", []),
        (lambda: Tendon([1e4, 1e4], [0.1, 0.1, 0.1]), "stiffness", [1e4, 1e4]),
        (lambda: Tendon(0.0, [0.1]), "stiffness[0]", 0.0),
        (lambda: Tendon([1e4, bad], [0.1]), "stiffness[1]", bad),
        (lambda: Tendon(STIFFNESS, [0.1], constant=-1.0), "constant", -1.0),
        (lambda: Tendon(STIFFNESS, [0.1], viscous=-1.0), "viscous", -1.0),
        (lambda: Tendon(STIFFNESS, [0.1], pretension=-1.0), "pretension", -1.0),
        (lambda: tendon.wind([0.0, 0.0, math.inf]), "wound[2]", math.inf),
        (lambda: tendon.wind([0.0, 0.0], [bad, 0.0]), "drawn[0]", bad),
        (lambda: tendon.pull([1.0, -2.0]), "tension[1]", -2.0),
        (lambda: tendon.wind([0.0], time_step=0.0), "time_step", 0.0),
    ]
    for call, key, value in calls:
        with refused(key, value):
            call()
    with pytest.raises(ArgumentError, match=r"^exponent is -0\.1; it must be a number from 0 to 10\.$"):
        transmit([1.0], -0.1)
    with pytest.raises(ValueError, match="shape"):
        tendon.wind([0.0, 0.0], [0.0, 0.0, 0.0])
    assert tendon.tensions == pytest.approx(PRETENSION, abs=0)
