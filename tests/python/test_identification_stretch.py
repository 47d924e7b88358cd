"""Of a long recording the stretch that says the most about an instrument's parameters is fitted."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.identification.formats.instrument_run import InstrumentRun, measured
from tenodesis.identification.stretch import shortened
from tenodesis.instrument import Instrument
from tenodesis.simulate import execute
from tenodesis.simulate.protocol import parse

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
