"""Claims about the wrist's model: what it reads, its derivatives, and how well it gives a real jaw's angle."""

import math
import os
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tenodesis.cli.identify import recordings_of
from tenodesis.errors import CommandError, IdentificationError
from tenodesis.identification import FORMATS, Fit, fit, jacobian_error
from tenodesis.identification.datasets.davinci_posture import LAWS, WristedTool, load
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.run import Array

from .conftest import refused
from .dataset_files import table, write
from .test_identification_davinci import motion, with_jaw

DATA = Path(os.environ.get("TENODESIS_DATA", Path(__file__).parents[3] / "shared" / "data")) / "davinci-posture"
PITCHES = (60, 0, -60)
TRUTH = {
    "offset": 1.2,
    "ratio": 0.95,
    "compliance": 1.0,
    "start": 0.3,
    "spindle_friction": 0.005,
    "friction_exponent": 0.5,
    "pretension": 0.05,
    "load_index": 0.8,
    "static_excess": 0.3,
    "stribeck_speed": 0.15,
    "coupling": -0.63,
    "wrist_friction": 0.8,
}


def posture(pitch: float, level: float = 0.08) -> MeasuredRun:
    run = motion(level, seconds=8, frequency=0.3)
    columns = {**run.columns, "jaw_angle": -run["spindle_angle"] - 0.63 * math.radians(pitch)}
    columns["wrist_pitch"] = np.full(len(run), math.radians(pitch))
    return MeasuredRun(f"pitch {pitch:g}", run.time, columns)


def values(wrist: WristedTool, **changes: float) -> Array:
    return np.array([(TRUTH | changes)[one.name] for one in wrist.parameters])


def simulated(law: str = "capstan-constant") -> list[MeasuredRun]:
    """Return a run for each posture whose jaw angle the model itself gives."""
    runs = [posture(pitch) for pitch in PITCHES]
    wrist = WristedTool(runs, law=law)
    return [with_jaw(run, wrist.predict(values(wrist), n)) for n, run in enumerate(runs)]


@pytest.mark.parametrize(("name", "pitch"), [("pitch+60_000", 60), ("pitch-7.5", -7.5), ("day2 Pitch 0_001", 0)])
def test_the_pitch_is_that_of_the_files_name(tmp_path: Path, name: str, pitch: float) -> None:
    path = write(tmp_path, table()).rename(tmp_path / f"{name}.TXT")
    run = load(path)
    assert run["wrist_pitch"] == pytest.approx(math.radians(pitch))
    assert f"pitch {pitch:g} deg, from the file's name" in run.notes


@pytest.mark.parametrize("name", ["000", "pitch", "pitch120", "pitch30_pitch60"])
def test_a_name_without_one_pitch_is_refused(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, table()).rename(tmp_path / f"{name}.TXT")
    sentence = f"{name}.TXT: the name '{name}' is no pitch angle; it must hold one from -90 to 90, in degrees"
    with pytest.raises(IdentificationError, match=re.escape(sentence)):
        load(path)


@pytest.mark.parametrize("law", LAWS)
def test_derivatives_agree_with_differences(law: str) -> None:
    wrist = WristedTool(simulated(law), law=law)
    for run in range(3):
        assert jacobian_error(wrist, values(wrist) * 1.03, run, quantile=0.98) < 2e-4


def test_a_recordings_own_offset_is_no_error_but_tells_of_the_coupling() -> None:
    runs = simulated()
    moved = [with_jaw(run, run["jaw_angle"] + shift) for run, shift in zip(runs, (0.03, -0.02, 0.05), strict=True)]
    wrist = WristedTool(moved)
    for run in range(3):
        assert np.abs(wrist.errors(values(wrist), run)["output_angle_deg"]).max() < 1e-9
        assert np.ptp(wrist.residuals(values(wrist), run)) < 1e-6 < abs(wrist.residuals(values(wrist), run)[0])


def test_pitch_moves_the_jaw_by_the_coupling_and_less_where_the_wrist_rubs() -> None:
    wrist = WristedTool(simulated())

    def loops(model: WristedTool, **changes: float) -> list[Array]:
        angles = [math.radians(pitch) for pitch in PITCHES]
        given = values(model, **changes)
        return [model.predict(given, n) - TRUTH["coupling"] * pitch for n, pitch in enumerate(angles)]

    smooth = loops(wrist, wrist_friction=0.0)
    assert all(np.abs(one - smooth[1]).max() < 1e-12 for one in smooth)
    held_back = [np.abs(one - free).mean() for one, free in zip(loops(wrist), smooth, strict=True)]
    assert held_back[0] > 1.1 * held_back[1] > 1.21 * held_back[2] > 1e-3
    assert [wrist.wrap(math.radians(pitch)) for pitch in (90, 0, -90)] == pytest.approx([math.pi, math.pi / 2, 0])
    # the other way round where the load is on the other tendon: both the spindle's signs are turned
    mirrored = WristedTool(
        [
            MeasuredRun(run.name, run.time, {**run.columns, "spindle_torque": -run["spindle_torque"]})
            for run in simulated()
        ]
    )
    assert mirrored.load == -wrist.load
    assert mirrored.wrap(0.4) == pytest.approx(wrist.wrap(-0.4))


def test_recordings_at_one_pitch_have_neither_coupling_nor_wrist() -> None:
    names = [one.name for one in WristedTool([posture(60), posture(60, 0.12)]).parameters]
    assert not {"coupling", "wrist_friction"} & set(names)


@pytest.mark.slow
def test_simulated_postures_give_back_the_wrists_parameters() -> None:
    runs = [posture(pitch, level) for pitch in PITCHES for level in (0.04, 0.12)]
    wrist = WristedTool(runs)
    exact = [with_jaw(run, wrist.predict(values(wrist), n)) for n, run in enumerate(runs)]
    found = fit(WristedTool(exact), train=range(6), starts=4)
    for name in ("coupling", "wrist_friction", "compliance", "friction_exponent"):
        assert found.values[name] == pytest.approx(TRUTH[name], rel=0.02), name


def test_a_law_without_an_exponent_is_refused() -> None:
    with refused("law", "coulomb", kind=IdentificationError):
        FORMATS["davinci-posture"].problem([posture(0)], [], law="coulomb", instrument=None)


def test_a_folder_stands_for_its_text_files_that_are_not_held_out(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("pitch0_1.TXT", "pitch0_2.TXT", "README.md")]
    for file in files:
        file.write_text("")
    assert recordings_of([tmp_path], [files[1]], "davinci-posture") == [files[0]]
    assert recordings_of([tmp_path], [], "mcap") == [tmp_path]
    (tmp_path / "empty").mkdir()
    with refused("LOG", kind=CommandError, allowed="a recording, or a folder with files that"):
        recordings_of([tmp_path / "empty"], [], "davinci-posture")


# --- a real grasper ------------------------------------------------------------------------------------------------

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA} (set TENODESIS_DATA)")
ALL = [f"pitch{pitch}_00{level}" for pitch in ("+60", "0", "-60") for level in range(4)]


@cache
def recording(name: str) -> MeasuredRun:
    return load(DATA / f"{name}.TXT")


@cache
def fitted(train: tuple[str, ...]) -> Fit:
    test = [name for name in ALL if name not in train]
    wrist = WristedTool([recording(n) for n in train], [recording(n) for n in test])
    return fit(wrist, train=range(len(train)), test=range(len(train), len(ALL)), starts=1)


def held_out(found: Fit, train: tuple[str, ...]) -> list[float]:
    return [one.rmse["output_angle_deg"] for one in found.files[len(train) :]]


@pytest.mark.data
@needs_data
def test_one_set_of_parameters_gives_held_out_loads_at_all_measured_postures() -> None:
    even = tuple(name for name in ALL if name[-1] in "02")
    odd = tuple(name for name in ALL if name[-1] in "13")
    assert max(held_out(fitted(even), even)) < 0.35
    assert max(held_out(fitted(odd), odd)) < 0.55


@pytest.mark.data
@needs_data
@pytest.mark.parametrize("pitch", ["pitch+60", "pitch0", "pitch-60"])
def test_a_posture_that_was_not_fitted_is_predicted(pitch: str) -> None:
    train = tuple(name for name in ALL if not name.startswith(f"{pitch}_"))
    assert max(held_out(fitted(train), train)) < 0.35


@pytest.mark.data
@needs_data
def test_the_measured_coupling_is_near_that_of_the_open_tool_file() -> None:
    # -0.630273: jhu-dvrk/sawIntuitiveResearchKit, share/tool/MARYLAND_BIPOLAR_FORCEPS_420172.json
    assert fitted(tuple(name for name in ALL if name[-1] in "02")).values["coupling"] == pytest.approx(-0.630, abs=0.03)
