"""Of a long recording the stretch that says the most about an instrument's parameters is fitted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.identification.formats.instrument_run import InstrumentRun, measured
from tenodesis.identification.split import shortened
from tenodesis.instrument import Instrument
from tenodesis.simulate import execute
from tenodesis.simulate.protocol import parse

from .conftest import Command

LONG = """
name = "much rest, little motion"
[[phases]]
kind = "hold"
duration = "4 s"
[[phases]]
kind = "cycles"
amplitude = "40 deg"
speed = "80 deg/s"
count = 3
[[phases]]
kind = "hold"
duration = "6 s"
"""


@pytest.fixture(scope="module")
def long() -> InstrumentRun:
    inst = tn.load("scaled-up")
    return measured(execute(tn.twin.Twin(inst), parse(LONG, "long")), inst, name="bench")


def test_the_stretch_with_the_motion_is_taken_and_says_so(long: InstrumentRun, scaled: Instrument) -> None:
    seen: list[tuple[int, int]] = []
    part = shortened(
        long, law="capstan", instrument=scaled, longest=3.0, progress=lambda done, total: seen.append((done, total))
    )
    # It moves from 4 s to 7 s.
    assert 4.0 < float(part.time[0] + part.time[-1]) / 2 < 7.0
    assert part.time[-1] - part.time[0] == pytest.approx(3.0, abs=0.01)
    assert np.ptp(part["handle_angle"]) == pytest.approx(np.radians(40), rel=0.01)
    assert part.name.startswith("bench (")
    assert "the 3 s from" in part.notes[-1]
    assert seen[-1][0] == seen[-1][1]


def test_a_short_recording_is_left_as_it_is(long: InstrumentRun, scaled: Instrument) -> None:
    assert shortened(long, law="capstan", instrument=scaled, longest=60.0) is long


def test_a_gap_as_long_as_a_stretch_is_left_out(long: InstrumentRun, scaled: Instrument) -> None:
    kept = (long.time < 7.5) | (long.time > 10.5)
    holed = replace(long, time=long.time[kept], columns={name: one[kept] for name, one in long.columns.items()})
    part = shortened(holed, law="capstan", instrument=scaled, longest=2.0)
    assert part.time[-1] < 7.5


@pytest.mark.slow
def test_the_command_fits_the_stretch_from_one_start(tenodesis: Command) -> None:
    Path("long.toml").write_text(LONG)
    tenodesis("record", "scaled-up", "long.toml", "--out", "long.mcap")
    choices = ("identify", "long.mcap", "--instrument", "scaled-up", "--arrangement", "file")
    code, out, err = tenodesis(*choices, "--fit", "friction.vertex_coefficient", "--longest", "3 s", "--overwrite")
    assert code == 0, err
    assert "the 3 s from" in out + err
    assert "one start is tried" in out + err
    code, _, err = tenodesis(*choices, "--longest", "1 ms", "--overwrite")
    assert (code, "--longest is '1 ms'; it must be at least 1 s." in err) == (1, True), err
    code, _, err = tenodesis(*choices, "--longest", "5 s", "--train-until", "0.5", "--overwrite")
    assert (code, "--longest is '5 s'; it must be left out" in err) == (1, True), err
