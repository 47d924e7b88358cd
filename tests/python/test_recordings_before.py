"""Recordings of version 0.1 open: one of two planar axes, one of joints that share tendons.

Every signal had the length of its name, and 1/8 more by row and 1/1024 more by column.
"""

from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.recording.summary import contents
from tenodesis.run import HELD, SIGNALS, Names

FOLDER = Path(__file__).parents[1] / "recordings"
ROWS = 3
PLANAR = Names.paired(["yaw", "pitch"])
SHARED = Names(("yaw", "pitch", "jaw"), ("handle_yaw",), ("a", "b", "c", "d", "grip"), ("yaw",))
OF_JAWS = {"wrench", "applied_grip_force", "grip_force"}


@pytest.mark.parametrize(("name", "names"), [("planar", PLANAR), ("shared_tendons", SHARED)])
def test_a_recording_of_before_has_all_its_signals_under_their_names(name: str, names: Names) -> None:
    recording = tn.Recording.open(FOLDER / f"{name}.mcap")
    run = recording.run
    assert (run.names, recording.left_out, recording.damage) == (names, {}, None)
    assert run.time.tolist() == pytest.approx([5e-4, 1e-3, 1.5e-3])
    for signal, values in run.signals().items():
        columns = np.arange(max(1, len(names.columns(signal))))
        expected = len(signal) + 0.125 * np.arange(ROWS)[:, np.newaxis] + 2**-10 * columns
        assert values.shape == names.shape(signal, ROWS)
        np.testing.assert_array_equal(run.by_column(signal), expected)
    assert contents(recording)["rows"] == ROWS
    table = tn.recording.tables.columns(run)
    assert {heading.partition(" ")[0] for heading in table} >= set(names.headings("tension"))


def test_what_was_recorded_before_is_there() -> None:
    planar, shared = (tn.Recording.open(FOLDER / f"{name}.mcap").run for name in ("planar", "shared_tendons"))
    assert planar.signals().keys() == SIGNALS.keys() - OF_JAWS - set(HELD) - {
        "commanded_spool_tension",
        "commanded_output_angle",
    }
    assert shared.signals().keys() >= OF_JAWS | {"output_angle", "handle_torque", "faults", "estimated_force_std"}
    assert planar["tension.pitch_agonist"].tolist() == planar["tension"][:, 2].tolist()
    assert planar.axis("pitch")["tension"].shape == (ROWS, 2)
