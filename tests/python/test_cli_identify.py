"""The command identify, on a format made up for the purpose."""

import json
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis.cli import common, identify
from tenodesis.errors import CommandError, IdentificationError
from tenodesis.files import atomic_file, atomic_files
from tenodesis.identification import FORMATS, Format, Parameter, Problem, Trace, report
from tenodesis.identification.formats.instrument_run import first_axis
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run

from .conftest import refused

STEP = 0.01


class Springs(Problem):
    """Tension over stretch: pretension and stiffness, which are keys of an instrument; the angle is their sum."""

    def __init__(self, measured: Sequence[MeasuredRun], inst: Instrument | None) -> None:
        self.measured, self.inst = measured, inst
        self.runs = tuple(one.name for one in measured)
        self.parameters = (
            Parameter("pretension", "N", 10.0, 0.0, 200.0, "tension of a tendon at rest"),
            Parameter("tendon_stiffness", "N/m", 2e4, 1e3, 1e6, "stiffness of a tendon"),
            Parameter("encoder_offset", "rad", 0.0, -0.5, 0.5, "angle that the encoder shows at zero"),
        )
        self.groups = {"stiffness": ("tendon_stiffness",)}

    def _model(self, values: Array, run: int) -> tuple[Array, Array]:
        stretch = self.measured[run]["stretch"]
        return values[0] + values[1] * stretch, 100 * stretch + values[2]

    def residuals(self, values: Array, run: int) -> Array:
        tension, angle = self._model(values, run)
        one = self.measured[run]
        return np.concatenate([(one["tension"] - tension) / 0.2, (one["angle"] - angle) / 1e-3])

    def jacobian(self, values: Array, run: int) -> Array | None:
        return None

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        return {key: one.measured - one.model for key, one in self.traces(values, run).items()}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        tension, angle = self._model(values, run)
        one = self.measured[run]
        return {
            "output_angle_deg": Trace(one.time, np.degrees(one["angle"]), np.degrees(angle)),
            "tension_N": Trace(one.time, one["tension"], tension),
        }

    def channels(self, run: int) -> int:
        return 2

    def sample_time(self, run: int) -> float:
        return STEP

    def instrument(self, values: Array) -> Instrument | None:
        return self.inst and self.inst.replace(pretension=float(values[0]), tendon_stiffness=float(values[1]))


@pytest.fixture(autouse=True)
def springs(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def load(path: Path) -> MeasuredRun:
        stretch, tension, angle = np.loadtxt(path)
        time = STEP * np.arange(stretch.size)
        return MeasuredRun(
            path.name, time, {"stretch": stretch, "tension": tension, "angle": angle}, ("dropped 1 row",)
        )

    def problem(
        train: Sequence[MeasuredRun], test: Sequence[MeasuredRun], *, law: str, instrument: Instrument | None
    ) -> Any:
        assert law == "capstan-constant"
        return Springs([*train, *test], instrument)

    laws = ("none", "coulomb", "capstan", "capstan-constant")
    monkeypatch.setitem(FORMATS, "tendon-sheath", Format(load, problem, laws, law="capstan-constant"))
    yield


def record(path: Path, seed: int, count: int = 400) -> Path:
    draw = np.random.default_rng(seed)
    stretch = 4e-4 * np.sin(2 * np.pi * 0.5 * STEP * np.arange(count))
    tension = 30 + 31172 * stretch + 0.2 * draw.normal(size=count)
    np.savetxt(path, [stretch, tension, 100 * stretch + 0.02 + 1e-3 * draw.normal(size=count)])
    return path


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    return [record(tmp_path / f"{n}.txt", n) for n in range(3)]


app = typer.Typer()
app.callback()(lambda: None)
app.command()(identify.identify)


def run(*arguments: object) -> Any:
    return CliRunner().invoke(
        app, ["identify", "--format", "tendon-sheath", *map(str, arguments)], catch_exceptions=False
    )


@pytest.mark.slow
def test_a_run_is_identified_and_written_as_page_numbers_and_instrument(logs: list[Path], tmp_path: Path) -> None:
    out, numbers = tmp_path / "out", tmp_path / "numbers.json"
    given = run(
        logs[0], logs[1], "--test", logs[2], "--instrument", "real-size", "--out", out, "--json-out", numbers,
        "--bootstrap", 40,
    )  # fmt: skip
    assert given.exit_code == 0, given.output
    found = json.loads(numbers.read_text())
    assert found == json.loads((out / "result.json").read_text())
    assert (found["format"], found["law"]) == ("tendon-sheath", "capstan-constant")
    assert found["train"] == ["0.txt", "1.txt"]
    assert found["test"] == ["2.txt"]
    stiffness = found["parameters"]["tendon_stiffness"]
    assert stiffness["interval_95"][0] < 31172 < stiffness["interval_95"][1]
    assert stiffness["bootstrap_interval_95"][0] < 31172 < stiffness["bootstrap_interval_95"][1]
    assert stiffness["unit"] == "N/m"
    assert stiffness["identifiable"] is True
    assert found["test_rmse_N"] == pytest.approx(0.2, rel=0.15)
    assert found["test_rmse_deg"] == pytest.approx(np.degrees(1e-3), rel=0.15)
    assert found["files"]["2.txt"]["rmse_deg"] == found["test_rmse_deg"]
    assert found["notes"]["0.txt"] == ["dropped 1 row"]
    inst = tn.load(out / "instrument.toml")
    assert inst.tendon_stiffness == pytest.approx(stiffness["value"], rel=1e-8)
    assert inst.pretension == pytest.approx(30, abs=0.1)
    page = (out / "report.html").read_text()
    assert not re.search(r"(src|href)=\"http|<script|<link|@import", page)
    for words in ("encoder offset", "held out", "2.txt", "residual [N]", "Ljung", ">N/m<", "largest [N]"):
        assert words in page
    assert "tendon_stiffness" in given.output
    assert "0.txt, 1.txt, 2.txt: dropped 1 row." in given.output


def test_only_what_fit_names_is_fitted_by_name_group_or_word(logs: list[Path], tmp_path: Path) -> None:
    given = run(logs[0], "--fit", "stiffness, offset", "--out", tmp_path / "out", "--json")
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert json.loads(given.output) == found
    fitted = [name for name, one in found["parameters"].items() if one["fitted"]]
    assert fitted == ["tendon_stiffness", "encoder_offset"]
    assert not (tmp_path / "out" / "instrument.toml").exists()
    with refused("--fit", "mu", kind=CommandError):
        run(logs[0], "--fit", "mu", "--out", tmp_path / "out", "--overwrite")


@pytest.mark.parametrize("linked", ["same", "hard", "soft"])
def test_an_input_is_never_written_over(logs: list[Path], tmp_path: Path, linked: str) -> None:
    own = tmp_path / "out" / "instrument.toml"
    own.parent.mkdir()
    text = Path("src/tenodesis/instruments/real-size.toml")
    own.write_text((Path(__file__).parents[2] / text).read_text("utf-8"), "utf-8")
    log = logs[0]
    if linked == "hard":
        log = tmp_path / "hard.txt"
        os.link(logs[0], log)
    elif linked == "soft":
        log = tmp_path / "soft.txt"
        log.symlink_to(logs[0])
    before = logs[0].read_bytes(), own.read_bytes()
    with refused("--json-out", kind=CommandError):
        run(logs[0], "--json-out", log, "--out", tmp_path / "other")
    with refused("--json-out", kind=CommandError):
        run(logs[1], "--test", logs[0], "--json-out", log, "--out", tmp_path / "other")
    with refused("--out", kind=CommandError):
        run(logs[0], "--instrument", own, "--out", own.parent)
    assert (logs[0].read_bytes(), own.read_bytes()) == before
    assert not (tmp_path / "other").exists()


def test_two_outputs_are_never_one_file_and_none_is_a_folder(logs: list[Path], tmp_path: Path) -> None:
    with refused("--json-out", kind=CommandError):
        run(logs[0], "--out", tmp_path / "out", "--json-out", tmp_path / "out" / "result.json")
    with refused("--json-out", kind=CommandError):
        run(logs[0], "--out", tmp_path / "out", "--json-out", tmp_path)


def test_what_is_no_regular_file_is_never_replaced(logs: list[Path], tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with refused("--json-out", kind=CommandError):
        run(logs[0], "--out", tmp_path / "out", "--json-out", pipe)
    with pytest.raises(OSError, match="pipe is no regular file"), atomic_file(pipe) as new:
        new.write_text("")
    with pytest.raises(OSError, match="pipe is no regular file"), atomic_files(tmp_path) as folder:
        for name in ("other", "pipe"):
            (folder / name).write_text("")
    assert pipe.is_fifo()
    assert not (tmp_path / "other").exists()


def test_what_cannot_be_asked_is_one_sentence(logs: list[Path], tmp_path: Path) -> None:
    for arguments, reason in (
        ((tmp_path / "none.txt",), "LOG is .*none.txt'; it must be the path of a recording"),
        ((logs[0], "--test", logs[0]), "--test is .* given once, not as LOG too"),
        ((logs[0], logs[0]), "LOG is .* given once, not as LOG too"),
        ((logs[0], "--law", "dahl"), "--law is 'dahl'; it must be one of none, coulomb, capstan"),
        ((logs[0], "--format", "xls"), "--format is 'xls'; it must be one of davinci-tool"),
        ((logs[0], "--bootstrap", 5), "--bootstrap is 5; it must be 0 for none, or at least 40"),
        ((logs[0], "--train-until", 1), r"--train-until is 1\.0; it must be between 0\.05 and 0\.95"),
        ((logs[0], "--train-from", -0.1), r"--train-from is -0\.1; it must be between 0\.05 and 0\.95"),
        ((logs[0], "--train-until", 0.5, "--train-from", 0.5), "are both given; give one of them"),
    ):
        with pytest.raises(CommandError, match=reason):
            run(*arguments, "--out", tmp_path / "out")
    for option, value in (("--starts", -1), ("--bootstrap", -1), ("--seed", -1), ("--loss", "huber")):
        given = run(logs[0], option, value, "--out", tmp_path / "out")
        assert given.exit_code == 2
        assert f"Invalid value for '{option}'" in " ".join(given.output.split())
    assert not (tmp_path / "out").exists()


def test_nothing_is_written_inside_an_input(logs: list[Path], tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    with refused("--out", kind=CommandError):
        run(bag, "--out", bag / "deep" / "out")
    with refused("--json-out", kind=CommandError):
        run(logs[0], "--test", bag, "--out", tmp_path / "out", "--json-out", bag / "numbers.json")
    assert list(bag.iterdir()) == []


def test_a_copy_is_the_same_recording_whatever_its_name(logs: list[Path], tmp_path: Path) -> None:
    copy = Path(shutil.copy(logs[0], tmp_path / "other.txt"))
    for arguments in ((logs[0], "--test", copy), (logs[0], copy)):
        with refused("LOG", "other.txt", kind=CommandError):
            run(*arguments, "--out", tmp_path / "out")


def write_pair(path: Path, lag: float) -> Path:
    """Write a joint's motion behind a lag, as the format endoscope-pair has it: s, deg, N."""
    time = 0.025 * np.arange(500)
    rows = np.zeros((500, 6))
    rows[:, 0], rows[:, 1], rows[:, 3] = time, 60 * np.sin(time), 40 * np.sin(time - lag)
    rows[:, 4], rows[:, 5] = 5 + 4 * np.sin(time + 0.3), 5 - 4 * np.sin(time + 0.2)
    rows[:, 3] += np.random.default_rng(round(100 * lag)).normal(0, 0.1, 500)
    np.savetxt(path, rows, delimiter=",")
    return path


def test_the_same_bytes_are_the_same_recording_whatever_bend_their_name_says(tmp_path: Path) -> None:
    one = write_pair(tmp_path / "60.txt", 0.2)
    copy = Path(shutil.copy(one, tmp_path / "120.txt"))
    with refused("LOG", "120.txt", kind=CommandError):
        run(one, "--test", copy, "--format", "endoscope-pair", "--law", "capstan", "--out", tmp_path / "out")


@pytest.mark.slow
def test_one_bend_tells_no_growth_with_it_and_another_one_held_out_is_extrapolation(tmp_path: Path) -> None:
    one, other = write_pair(tmp_path / "60.txt", 0.2), write_pair(tmp_path / "120.txt", 0.25)
    options = ("--format", "endoscope-pair", "--law", "capstan", "--out", tmp_path / "out", "--starts", 1)
    given = run(one, "--test", other, *options)
    assert given.exit_code == 0, given.output
    assert "120.txt: held out at a sheath bend of 120 deg, fitted at 60 deg: extrapolation" in given.output
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert not [name for name in found["parameters"] if name.endswith("_per_bend")]


@pytest.mark.slow
def test_a_fit_that_explains_little_is_called_poor_and_so_is_its_instrument(logs: list[Path], tmp_path: Path) -> None:
    stretch, tension, angle = np.loadtxt(logs[1])
    np.savetxt(logs[1], [stretch, tension, -angle])
    options = ("--instrument", "real-size", "--starts", 1)
    good = run(logs[0], *options, "--out", tmp_path / "good")
    poor = run(logs[0], "--test", logs[1], *options, "--out", tmp_path / "poor")
    assert "explains little" not in good.output
    assert "The model explains little of output angle of 1.txt (rmse " in poor.output
    assert "look for a reversed sign, swapped columns, a frozen sensor or a wrong unit." in poor.output
    assert "The error of output angle is " in poor.output
    assert "poor fit" not in (tmp_path / "good" / report.INSTRUMENT).read_text()
    text = (tmp_path / "poor" / report.INSTRUMENT).read_text()
    assert "# From a poor fit: do not rely on these values.\n# The model explains little of output angle" in text
    assert tn.instrument.load(str(tmp_path / "poor" / report.INSTRUMENT)).pretension > 0


@pytest.mark.slow
def test_files_of_one_name_go_by_their_folders(logs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "day2").mkdir()
    other = Path(shutil.copy(logs[1], tmp_path / "day2" / "0.txt"))
    run(logs[0], "--test", other, "--out", tmp_path / "out")
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["train"] == [f"{tmp_path.name}/0.txt"]
    assert found["test"] == ["day2/0.txt"]
    assert set(found["notes"]) == {f"{tmp_path.name}/0.txt", "day2/0.txt"}


@pytest.mark.slow
@pytest.mark.parametrize(("option", "fitted"), [("--train-until", "until"), ("--train-from", "from")])
def test_one_recording_is_fitted_in_part_and_held_out_for_the_rest(
    logs: list[Path], tmp_path: Path, option: str, fitted: str
) -> None:
    stretch, tension, angle = np.loadtxt(logs[0])
    tension[300:] += 3.0
    np.savetxt(logs[0], [stretch, tension, angle])
    given = run(logs[0], option, 0.75, "--test", logs[1], "--out", tmp_path / "out", "--starts", 1)
    assert given.exit_code == 0, given.output
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    early, late = "0.txt (until 2.993 s)", "0.txt (from 2.993 s)"
    assert found["train"] == [early if fitted == "until" else late]
    assert found["test"] == [late if fitted == "until" else early, "1.txt"]
    assert {name: one["samples"] for name, one in found["files"].items()} == {early: 300, late: 100, "1.txt": 400}
    assert found["parameters"]["pretension"]["value"] == pytest.approx(30 if fitted == "until" else 33, abs=0.1)
    assert found["files"][found["test"][0]]["rmse_N"] == pytest.approx(3.0, rel=0.05)
    assert found["train_rmse_N"] == pytest.approx(0.2, rel=0.2)
    for words in (early, late):
        assert words in (tmp_path / "out" / "report.html").read_text()


def test_notes_that_differ_by_the_files_name_alone_are_one() -> None:
    notes = {
        "a/0.txt": ("0.txt is as published.", "3 gaps"),
        "b/1.txt": ("1.txt is as published",),
        "2.txt": ("3 gaps",),
    }
    assert report.grouped(notes) == [("a/0.txt, b/1.txt", "… is as published"), ("a/0.txt, 2.txt", "3 gaps")]
    assert report.grouped({"0.txt": ("0.txt is new.",)}) == [("0.txt", "0.txt is new")]


@pytest.mark.slow
def test_held_out_files_leave_parameters_alone(logs: list[Path], tmp_path: Path) -> None:
    record(tmp_path / "strange.txt", 99, 250)
    for name, test in (("a", logs[2]), ("b", tmp_path / "strange.txt")):
        run(logs[0], logs[1], "--test", test, "--out", tmp_path / name, "--bootstrap", 40)
    one, other = (json.loads((tmp_path / name / "result.json").read_text()) for name in ("a", "b"))
    assert one["parameters"] == other["parameters"]
    assert one["test_rmse_N"] != other["test_rmse_N"]


def test_on_eighty_columns_no_interval_breaks(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(common.console, "width", 80)
    shown = run(logs[0], "--bootstrap", 40, "--out", tmp_path / "out").output
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    rows = [line for line in shown.splitlines() if " … " in line]
    assert len(rows) == sum(bool(one["fitted"]) for one in found["parameters"].values())
    assert all(line.count(" … ") == 1 and len(line) <= 80 for line in rows)


def test_a_run_whose_first_joint_shares_its_tendons_is_refused_in_one_sentence() -> None:
    run = Run(np.arange(3.0), ("pitch", "jaw_1"), (), ("one", "other"), output_angle=np.zeros((3, 2)))
    with refused("joint", "pitch", kind=IdentificationError):
        first_axis(run)
