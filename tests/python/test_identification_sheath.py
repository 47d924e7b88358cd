"""Claims about one sheathed tendon: what its model recovers, what its files may be, and tensions measured by others."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS, fit, jacobian_error
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.formats.tendon_sheath import GRAM_FORCE, halves, load
from tenodesis.identification.laws import LAWS
from tenodesis.identification.models.sheath import Sheath, problem
from tenodesis.signals import Array
from tenodesis.tendon import transmit

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("TENODESIS_DATA", ROOT.parent / "shared" / "data")) / "tendon-sheath"
PLAY = [law for law in LAWS if law != "bouc-wen"]


def pulls(count: int = 1500) -> tuple[Array, Array]:
    time = 0.012 * np.arange(count)
    return time, 6 - 5 * np.cos(1.4 * time) + 0.8 * np.sin(5 * time)


def recording(distal: Array | None = None) -> Measured:
    time, proximal = pulls()
    columns = {"proximal_tension": proximal, "distal_tension": np.zeros(time.size) if distal is None else distal}
    return Measured("made.csv", time, columns)


def made(noise: float, seed: int = 0) -> Measured:
    random = np.random.default_rng(seed)
    return recording(transmit(pulls()[1], 0.6, gain=0.84) + noise * random.normal(size=1500))


def test_model_is_the_tendons_own_contact() -> None:
    model = Sheath([recording()])
    assert model.distal_tension(np.array([0.84, 0.6]), 0) == pytest.approx(
        transmit(pulls()[1], 0.6, gain=0.84), rel=1e-12
    )


@pytest.mark.parametrize("law", PLAY)
def test_derivatives_are_those_of_differences(law: str) -> None:
    model = Sheath([recording()], law=law)
    at = 1.07 * np.array([one.start for one in model.parameters])
    assert jacobian_error(model, at, 0, quantile=0.98) < 1e-6


def test_exponent_and_gain_are_found_again_within_their_intervals() -> None:
    found = fit(Sheath([made(0.02)]), train=[0], starts=3)
    for name, true in (("gain", 0.84), ("exponent", 0.6)):
        low, high = found.interval_95[name]
        assert low <= true <= high
        assert high - low < 0.01


def test_halves_of_one_recording_predict_each_other() -> None:
    first, second = halves(made(0.02))
    assert len(first) + len(second) == 1500
    model = Sheath([first, second])
    for train, test in ((0, 1), (1, 0)):
        found = fit(model, train=[train], test=[test], starts=2)
        # how the second half began is not known: its contact is let go from the proximal tension
        assert found.test_rmse["tension_N"] < 0.5
        assert found.values["exponent"] == pytest.approx(0.6, abs=0.02)


def test_bad_requests_are_named() -> None:
    with pytest.raises(IdentificationError, match="law is 'magic'"):
        Sheath([recording()], law="magic")
    with pytest.raises(IdentificationError, match="train is empty"):
        Sheath([])
    with pytest.raises(IdentificationError, match="instrument is given"):
        problem([recording()], [], law="capstan", instrument=object())  # type: ignore[arg-type]


# --- files -------------------------------------------------------------------------------------------------------

HEAD = ",Time,layout.dim,layout.data_offset,data_0,data_1,data_2,data_3"


def write(path: Path, proximal: Array, distal: Array, head: str = HEAD, step: float = 0.012) -> Path:
    rows = [
        f"{index},{step * index:.6f},[],0,{one:.6f},0.1,{other:.6f},0.2"
        for index, (one, other) in enumerate(zip(proximal, distal, strict=True))
    ]
    path.write_text("\n".join([head, *rows]))
    return path


def test_gram_force_becomes_newton_and_spikes_go(tmp_path: Path) -> None:
    proximal = pulls()[1] / GRAM_FORCE
    distal = 0.5 * proximal
    distal[700] += 300
    measured = load(write(tmp_path / "a.csv", proximal, distal))
    assert measured["distal_tension"] == pytest.approx(0.5 * pulls()[1], abs=0.06)
    assert any("took 1 spikes" in note for note in measured.notes)


def test_newton_are_seen_by_their_magnitude_and_said(tmp_path: Path) -> None:
    measured = load(write(tmp_path / "a.csv", pulls()[1], 0.5 * pulls()[1]))
    assert measured["proximal_tension"] == pytest.approx(pulls()[1], abs=0.06)
    assert any("taken as N, not gram-force" in note for note in measured.notes)


def test_files_that_cannot_be_used_are_refused_with_the_reason(tmp_path: Path) -> None:
    proximal = pulls()[1] / GRAM_FORCE
    path = tmp_path / "a.csv"
    with pytest.raises(IdentificationError, match="has no column data_2"):
        load(write(path, proximal, proximal, HEAD.replace("data_2", "data_9")))
    with pytest.raises(IdentificationError, match="100 samples are left"):
        load(write(path, proximal[:100], proximal[:100]))
    with pytest.raises(IdentificationError, match="no excitation: proximal_tension"):
        load(write(path, np.full(500, 3.0), np.full(500, 3.0)))
    with pytest.raises(IdentificationError, match=r"the clock ran back|no clock"):
        load(write(path, proximal, proximal, step=-0.012))
    with pytest.raises(IdentificationError, match=r"b\.csv cannot be read"):
        load(tmp_path / "b.csv")


# --- measured by others ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def measured() -> Measured:
    """The published recording; the data are not shipped."""
    path = DATA / "2024-01-08-loadcells.csv"
    if not path.is_file():
        pytest.skip(f"no measured tensions at {path}: set TENODESIS_DATA to the folder that holds tendon-sheath/")
    return FORMATS["tendon-sheath"].load(path)


def test_one_exponent_and_one_gain_give_the_measured_distal_tension(measured: Measured) -> None:
    found = fit(Sheath([measured]), train=[0], starts=3)
    print(f"{found.values}: {found.train_rmse['tension_N']:.4f} N")
    assert found.train_rmse["tension_N"] <= 0.20
    assert found.values["gain"] == pytest.approx(0.84, abs=0.02)
    # the authors' own figures: a coefficient of 0.058 over a bend of 11.7 rad
    assert found.values["exponent"] == pytest.approx(0.058 * 11.7, rel=0.15)


def test_halves_predict_each_other_better_than_a_straight_line_does(measured: Measured) -> None:
    # The first half holds one pull to 7.7 N, within which the far end is drawn by hand; in the second, to 13.8 N, the
    # sheath gives way at 15.7 s and rubs less from there on. What the first half tells is not enough for the second.
    model = Sheath(halves(measured))
    crossed = {}
    for train, test in ((0, 1), (1, 0)):
        found = fit(model, train=[train], test=[test], starts=3)
        crossed[model.runs[test]] = found.test_rmse["tension_N"]
    print(f"predicted from the other half: {crossed} N")
    assert crossed[model.runs[0]] <= 0.22
    assert crossed[model.runs[1]] <= 0.55
    line = np.polynomial.Polynomial.fit(measured["proximal_tension"], measured["distal_tension"], 1)
    straight = measured["distal_tension"] - line(measured["proximal_tension"])
    assert max(crossed.values()) < math.sqrt(float(np.mean(straight**2)))
