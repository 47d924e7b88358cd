"""A script joins a live instrument: it moves, loads, switches, reads and records, and leaves a pause."""

import runpy

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import LiveError
from tenodesis.live.client import Client

from .conftest import EXAMPLES, refused, until
from .test_live_operator import events, served

__all__ = ["served"]
pytestmark = pytest.mark.process


def test_the_example_repeats_records_and_leaves_a_pause(served, capsys):
    folder, _ = served
    run = runpy.run_path(str(EXAMPLES / "ten_repetitions.py"))["main"]
    found = run(str(folder), repetitions=2, settle=0.05)
    assert [set(one) for one in found] == [{"off", "robust"}] * 2
    path = capsys.readouterr().out.partition("Recorded to ")[2].strip().removesuffix(".")
    assert np.abs(tn.Recording.open(path).run["commanded_handle_angle"]).max() > 0.3
    sent = [one["event"] for one in events(folder) if one.get("origin") == "ten repetitions"]
    assert {"operator", "hand", "force", "law"} <= set(sent), sent
    until(lambda: Client(folder, "other").status().operator is None)
    # The pause that the first script left does not keep the next one from working.
    assert Client(folder, "other").status().state == "PAUSED"
    with tn.live.connect(folder, "another") as another:
        another.request("enable")
        assert another.status().state == "ENABLED"


def test_a_recording_has_begun_when_record_returns_and_a_handle_beyond_its_range_is_refused(served):
    folder, _ = served
    with tn.live.connect(folder, "one") as one:
        path = one.record(True, "mine")
        begun = one.latest()["time"]
        with refused("angles, of handle_yaw", 99.0, kind=LiveError, allowed="to either side"):
            one.hand([99.0])
        one.record(False)
        assert one.status().recording is None
        assert tn.Recording.open(path).run.time[0] <= begun


def test_it_takes_over_by_force_only(served):
    folder, _ = served
    with tn.live.connect(folder, "one") as one:
        with refused("operator", "one", kind=LiveError, allowed="force"):
            tn.live.connect(folder, "two")
        with tn.live.connect(folder, "two", force=True) as two:
            assert two.status().operator == "two"
        assert not one.heartbeat()
