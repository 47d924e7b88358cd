"""Claims about one sheathed tendon: what its model recovers, what its files may be, and tensions measured by others."""

import os
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS, fit, jacobian_error
from tenodesis.identification.datasets.reference import LAWS, band
from tenodesis.identification.datasets.tendon_sheath import DEFAULT_LOSS, Sheath
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.results import Fit
from tenodesis.identification.split import FittedPart, split
from tenodesis.identification.uncertainty import LossName
from tenodesis.run import Array
from tenodesis.tendon import transmit

from .conftest import refused

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("TENODESIS_DATA", ROOT.parent / "shared" / "data")) / "tendon-sheath"


def pulls(count: int = 1500) -> tuple[Array, Array]:
    time = 0.012 * np.arange(count)
    return time, 6 - 5 * np.cos(1.4 * time) + 0.8 * np.sin(5 * time)


def recording(distal: Array | None = None) -> MeasuredRun:
    time, proximal = pulls()
    columns = {"proximal_tension": proximal, "distal_tension": np.zeros(time.size) if distal is None else distal}
    return MeasuredRun("made.csv", time, columns)


def made(noise: float, seed: int = 0) -> MeasuredRun:
    random = np.random.default_rng(seed)
    return recording(transmit(pulls()[1], 0.6, gain=0.84) + noise * random.normal(size=1500))


def test_model_is_the_tendons_own_contact() -> None:
    model = Sheath([recording()], law="capstan")
    assert model.predict(np.array([0.84, 0.6]), 0) == pytest.approx(transmit(pulls()[1], 0.6, gain=0.84), rel=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_derivatives_are_those_of_differences(law: str) -> None:
    model = Sheath([recording()], law=law)
    at = 1.07 * np.array([one.start for one in model.parameters])
    assert jacobian_error(model, at, 0, quantile=0.98) < 1e-6


@pytest.mark.parametrize(("exponent", "index"), [(0.8, 0.82), (0.4, 0.5), (0.6, 0.9999999), (0.6, 1.0)])
def test_power_law_is_the_integral_of_friction_along_the_way(exponent: float, index: float) -> None:
    tension = np.array([0.05, 0.5, 3.0, 14.0])
    bounds = band("capstan-power", {"exponent": exponent, "load_index": index}, tension)
    for sign, bound in zip((-1, 1), bounds, strict=True):

        def rubs(_: float, along: Array, sign: int = sign) -> Array:
            return np.asarray(sign * exponent * np.maximum(along, 0) ** index)

        far = solve_ivp(rubs, (0, 1), tension, rtol=1e-10, atol=1e-13).y[:, -1]
        assert bound == pytest.approx(far, rel=1e-6, abs=1e-6)


def test_load_index_is_found_again_within_its_interval() -> None:
    truth = np.array([0.84, 0.8, 0.82])
    blank = Sheath([recording()], law="capstan-power")
    noise = 0.02 * np.random.default_rng(3).normal(size=1500)
    found = fit(Sheath([recording(blank.predict(truth, 0) + noise)], law="capstan-power"), train=[0], starts=3)
    for name, true in zip(("gain", "exponent", "load_index"), truth, strict=True):
        low, high = found.interval_95[name]
        assert low <= true <= high
        assert high - low < 0.03


def parts(measured: MeasuredRun, fitted: FittedPart, *, law: str, loss: LossName = "linear") -> Fit:
    """Fit a half of a recording, and hold the other out."""
    model = split([measured], [], 0.5, fitted, lambda train, test: Sheath([*train, *test], law=law))
    return fit(model, train=[0], test=[1], starts=2, loss=loss)


@pytest.mark.parametrize("fitted", get_args(FittedPart))
def test_either_half_of_a_recording_predicts_the_other_to_the_sensors_noise(fitted: FittedPart) -> None:
    found = parts(made(0.02), fitted, law="capstan")
    assert found.test_rmse["tension_N"] == pytest.approx(0.02, rel=0.15)
    assert found.values["exponent"] == pytest.approx(0.6, abs=0.01)
    assert sum(one.samples["tension_N"] for one in found.files) == 1500


def test_what_is_held_out_of_a_recording_does_not_reach_the_fit() -> None:
    measured = made(0.02)
    late = measured.time >= 0.5 * measured.time[-1]
    spoilt = recording(np.where(late, 7.0, measured["distal_tension"]))
    one, other = parts(measured, "until", law="capstan"), parts(spoilt, "until", law="capstan")
    assert one.values == other.values
    assert other.test_rmse["tension_N"] > 10 * one.test_rmse["tension_N"]


def test_a_recording_is_split_where_something_is_left_on_either_side() -> None:
    with refused("share", 1.0, kind=IdentificationError):
        split([recording()], [], 1.0, "until", lambda train, test: Sheath([*train, *test]))


# --- measured by others ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def measured() -> MeasuredRun:
    """The published recording; the data are not shipped."""
    path = DATA / "2024-01-08-loadcells.csv"
    if not path.is_file():
        pytest.skip(f"no measured tensions at {path}: set TENODESIS_DATA to the folder that holds tendon-sheath/")
    return FORMATS["tendon-sheath"].load(path)


@pytest.mark.data
def test_one_exponent_and_one_gain_give_the_measured_distal_tension(measured: MeasuredRun) -> None:
    found = fit(Sheath([measured], law="capstan"), train=[0], starts=3)
    print(f"{found.values}: {found.train_rmse['tension_N']:.4f} N")
    assert found.train_rmse["tension_N"] <= 0.20
    assert found.values["gain"] == pytest.approx(0.84, abs=0.02)
    # the authors' own figures: a coefficient of 0.058 over a bend of 11.7 rad
    assert found.values["exponent"] == pytest.approx(0.058 * 11.7, rel=0.15)


@pytest.mark.data
def test_friction_of_the_measured_sheath_grows_with_a_power_of_the_tension_below_one(measured: MeasuredRun) -> None:
    found = fit(Sheath([measured]), train=[0], starts=3, loss=DEFAULT_LOSS)
    print(f"{found.values}: {found.train_rmse['tension_N']:.4f} N")
    assert found.train_rmse["tension_N"] <= 0.15
    # for polymers between two thirds (Hertz) and one (Amontons)
    low, high = found.interval_95["load_index"]
    assert 2 / 3 < low < high < 1


@pytest.mark.data
def test_either_half_of_the_measured_recording_predicts_the_other(measured: MeasuredRun) -> None:
    # The halves are unlike: pulls end at 7.7 N in the first and at 13.8 N in the second.
    for fitted in get_args(FittedPart):
        power = parts(measured, fitted, law="capstan-power", loss=DEFAULT_LOSS)
        print(f"fitted {power.files[0].name}: {power.test_rmse['tension_N']:.3f} N held out; {power.values}")
        assert power.test_rmse["tension_N"] <= 0.20
        assert power.values["load_index"] == pytest.approx(0.84, abs=0.04)
        capstan = parts(measured, fitted, law="capstan", loss=DEFAULT_LOSS)
        assert power.cost < capstan.cost
        assert power.test_rmse["tension_N"] < 0.8 * capstan.test_rmse["tension_N"]


@pytest.mark.data
def test_no_friction_is_a_law_to_compare_with(measured: MeasuredRun) -> None:
    found = fit(Sheath([measured], law="none"), train=[0], starts=2, loss=DEFAULT_LOSS)
    assert found.train_rmse["tension_N"] > 4 * 0.15
    proximal, distal = (measured[name] for name in ("proximal_tension", "distal_tension"))
    straight = np.polynomial.Polynomial.fit(proximal, distal, 1)
    assert np.sqrt(np.mean((straight(proximal) - distal) ** 2)) == pytest.approx(0.82, abs=0.01)
