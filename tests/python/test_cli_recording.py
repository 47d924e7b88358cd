"""Claims about the commands for recordings: they chain, and every mistake ends in one sentence."""

import json
import math
import re
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap_ros2.writer import Writer as StockWriter

import tenodesis as tn
from tenodesis.cli import common, interrupts
from tenodesis.errors import Error
from tenodesis.live import recorder as live
from tenodesis.recording import Recorder, Recording
from tenodesis.run import Run

from .conftest import EXAMPLES, ROOT, Command, start_command, until
from .live_loop import Played

"""Takes the words of a command line; returns exit code, output and errors."""

PROTOCOL = """
name = "short"
[[phases]]
kind = "cycles"
amplitude = "15 deg"
period = "0.3 s"
count = 1
force = "0.5 N"
"""


@pytest.fixture(autouse=True)
def protocol(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(PROTOCOL)


def test_record_info_replay_export(tenodesis: Command, tmp_path: Path) -> None:
    code, out, _ = tenodesis("record", "scaled-up", "short.toml", "--seed", "7")
    assert code == 0
    said, tip, tensions, slack = out.splitlines()
    assert said == f"recordings/short-scaled-up.mcap: short on scaled-up, 0.3 s, 600 rows, {said.split(', ')[-1]}"
    assert tip.startswith("tip: yaw ") and "unloaded angle" in tip
    assert tensions.startswith("tensions: yaw_agonist ")
    assert slack == "slack: no tendon."
    file = "recordings/short-scaled-up.mcap"
    code, out, _ = tenodesis("info", file, file)
    assert (code, out.count("scaled-up  ")) == (0, 2)
    code, out, _ = tenodesis("replay", file, "--out", "again.mcap", "--plot-out", "again.svg")
    assert code == 0
    assert out.splitlines()[0] == f"{file}: replayed bit by bit on scaled-up, 0.3 s, 600 rows."
    assert (tmp_path / "again.svg").read_text().count("<svg") == 1
    for name in ("run.csv", "run.parquet"):
        code, out, _ = tenodesis("export", "recording", "again.mcap", "--out", name)
        assert (code, out.startswith(f"{name}: 600 rows")) == (0, True)
    run = Recording.open(file).run
    assert run.output_angle is not None
    assert (pd.read_parquet("run.parquet")["output_angle.yaw [rad]"].to_numpy() == run.output_angle).all()
    assert (pd.read_csv("run.csv")["time [s]"].to_numpy() == run.time).all()


def test_replay_on_another_instrument_prints_the_differences(tenodesis: Command, tmp_path: Path) -> None:
    tenodesis("record", "scaled-up", "short.toml", "--out", "run.mcap", "--time-step", "0.25 ms", "--quasi-static")
    code, out, _ = tenodesis("replay", "run.mcap", "--instrument", EXAMPLES / "pulley.toml", "--plot-out", "x.png")
    assert code == 0
    assert "bit by bit" not in out
    for word in ("output_angle.yaw", "deg", "tension.yaw.antagonist", "N"):
        assert word in out
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_both_axes_or_one_are_recorded(tenodesis: Command) -> None:
    assert tenodesis("record", "real-size", "short.toml")[0] == 0
    assert tenodesis("record", "real-size", "short.toml", "--axis", "pitch", "--out", "pitch.mcap")[0] == 0
    assert Recording.open("recordings/short-real-size.mcap").run.axes == ("yaw", "pitch")
    assert Recording.open("pitch.mcap").run.axes == ("pitch",)
    assert "bit by bit" in tenodesis("replay", "recordings/short-real-size.mcap", "--plot-out", "both.png")[1]


def test_a_truncated_recording_is_shown_replayed_and_exported(tenodesis: Command, tmp_path: Path) -> None:
    tenodesis("record", "scaled-up", "short.toml", "--out", "run.mcap")
    data = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(data[: len(data) * 9 // 10])
    assert "is read up to" in tenodesis("info", "run.mcap")[1]
    code, out, _ = tenodesis("replay", "run.mcap")
    assert code == 0
    assert "run.mcap is read up to" in out
    assert "bit by bit" in out
    assert tenodesis("export", "recording", "run.mcap", "--out", "run.csv")[0] == 0


@pytest.mark.slow
def test_a_controller_is_recorded_shown_and_replayed(tenodesis: Command, tmp_path: Path) -> None:
    (tmp_path / "slack.toml").write_text(PROTOCOL.replace("[[phases]]", '[[phases]]\nkind = "pretension"\n[[phases]]'))
    choices = ("--law", "robust", "--observer", "friction", "--actuation", "differential")
    code, out, _ = tenodesis("record", "scaled-up", "slack.toml", *choices, "--out", "run.mcap")
    assert code == 0
    said = out.splitlines()
    assert said[0].startswith("run.mcap: short on scaled-up, ")
    assert said[1].startswith("state: ENABLED at the end (ENABLED ")
    assert said[2] == "faults: none."
    assert said[3].startswith("tip: yaw ")
    assert "deg off the unloaded angle at the end" in said[3]
    out = tenodesis("info", "run.mcap")[1]
    assert "robust law, friction observer, differential actuation " in out
    for line in said[1:]:
        about, fact = line.rstrip(".").split(": ", 1)
        assert any(re.split(r"\s{2,}", row)[0] == about and fact in row for row in out.splitlines())
    code, out, _ = tenodesis("replay", "run.mcap")
    assert (code, "replayed bit by bit on scaled-up" in out) == (0, True)
    assert tenodesis("export", "recording", "run.mcap", "--out", "run.csv")[0] == 0
    assert "estimated_force.yaw [N]" in pd.read_csv("run.csv").columns


def test_a_controller_may_be_told_another_instrument(tenodesis: Command, tmp_path: Path) -> None:
    text = (ROOT / "instruments" / "scaled-up.toml").read_text("utf-8")
    (tmp_path / "known.toml").write_text(text.replace("stiffness_ratio = 0.85", "").replace("50 GPa", "42.5 GPa"))
    told = ("--law", "robust", "--controller-instrument", "known.toml")
    tenodesis("record", "scaled-up", "short.toml", *told, "--out", "run.mcap")
    assert "made for another instrument (scaled-up)" in tenodesis("info", "run.mcap")[1]
    assert "bit by bit" in tenodesis("replay", "run.mcap")[1]
    assert Recording.open("run.mcap").metadata["controller_instrument"].count("42500000000.0")


def test_a_replay_on_another_instrument_keeps_what_its_controller_was_told(tenodesis: Command, tmp_path: Path) -> None:
    text = (ROOT / "instruments" / "scaled-up.toml").read_text("utf-8")
    (tmp_path / "soft.toml").write_text(text.replace("50 GPa", "40 GPa"))
    tenodesis("record", "scaled-up", "short.toml", "--law", "exact", "--observer", "exact")
    file = "recordings/short-scaled-up-exact.mcap"
    code, out, _ = tenodesis("replay", file, "--instrument", "soft.toml", "--out", "again.mcap")
    assert code == 0
    assert "faults: none." in out
    assert "bit by bit" in tenodesis("replay", "again.mcap")[1]


def test_a_controller_of_both_axes_or_of_one(tenodesis: Command) -> None:
    known = ("--law", "robust", "--controller-instrument", "real-size")
    code, out, _ = tenodesis("record", "real-size", "short.toml", *known, "--out", "both.mcap")
    assert (code, "; pitch " in out) == (0, True)
    assert tenodesis("record", "real-size", "short.toml", *known, "--axis", "pitch", "--out", "pitch.mcap")[0] == 0
    for file in ("both.mcap", "pitch.mcap"):
        assert "bit by bit" in tenodesis("replay", file)[1]


@pytest.mark.parametrize(
    ("options", "key"),
    [
        (("--law", "robust", "--observer", "paper"), "observer"),
        (("--law", "robust", "--controller-instrument", str(EXAMPLES / "pulley.toml")), "controller"),
        (("--law", "robust", "--controller-instrument", "real-size"), "controller"),
        (("--law", "robust", "--controller-instrument", "absent"), "file"),
        (("--observer", "exact"), "--observer"),
        (("--controller-instrument", "scaled-up"), "--controller-instrument"),
    ],
)
def test_a_controller_that_cannot_be_is_refused(
    declined: Callable[..., Error], tmp_path: Path, options: tuple[str, ...], key: str
) -> None:
    assert declined("record", "scaled-up", "short.toml", *options, "--out", "run.mcap").key == key
    assert not (tmp_path / "run.mcap").exists()


@pytest.mark.parametrize(
    ("words", "key"),
    [
        ("record scaled-up far.toml", "amplitude"),
        ("record scaled-up short.toml --time-step 1_s --out x.mcap", "time_step"),
        ("record scaled-up short.toml --seed -1 --out x.mcap", "seed"),
        ("record scaled-up short.toml --axis pitch", "axis"),
        ("info absent.mcap", "path"),
        ("info far.toml", "path"),
        ("info other.mcap", "topics"),
        ("replay other.mcap", "topics"),
        ("replay run.mcap --instrument real-size", "joints"),
        ("record scaled-up heavy.toml --out x.mcap --quasi-static", "load"),
    ],
)
def test_a_mistake_is_refused_by_its_key(
    tenodesis: Command, declined: Callable[..., Error], tmp_path: Path, words: str, key: str
) -> None:
    tenodesis("record", "scaled-up", "short.toml", "--out", "run.mcap")
    (tmp_path / "far.toml").write_text(PROTOCOL.replace("15 deg", "60 deg"))
    (tmp_path / "heavy.toml").write_text(
        'name = "heavy"\nphases = [{kind = "hold", duration = "1 s"}, '
        '{kind = "ramp", duration = "0.9 s", force = "300 N"}]\n'
    )
    with (tmp_path / "other.mcap").open("wb") as stream:
        writer = StockWriter(stream)
        schema = writer.register_msgdef("std_msgs/msg/String", "string data")
        writer.write_message("/chatter", schema, {"data": "hello"})
        writer.finish()
    assert declined(*(word.replace("_s", " s") for word in words.split())).key == key
    assert (tmp_path / "x.mcap").exists() is (key == "load"), "what was recorded until then is kept"


def shown_by(out: str) -> dict[str, str]:
    """What is said by what it is about, of the lines that have both."""
    return {line[: line.index("  ")]: line[line.index("  ") :].strip() for line in out.splitlines() if "  " in line}


def test_info_tells_the_events_faults_and_gaps_of_a_live_recording(tenodesis: Command, tmp_path: Path) -> None:
    twin = tn.twin.Twin(tn.load("scaled-up"), seed=3)
    tension = tn.simulate.FaultInjection("tension.agonist", "set", math.nan, start=0.05, stop=0.06)
    controller = tn.control.Controller(twin.inst)
    run = twin.run(np.zeros(400), controller=controller, fault_injection=[tension])
    assert run.faults is not None
    first = run.time[np.flatnonzero(run.faults)[0]]
    happened = [
        {"time": 0.01, "event": "hand", "origin": "browser 1", "angles": [0.1], "times": 12},
        {"time": 0.02, "event": "hand", "origin": "browser 1", "angles": [0.2], "times": 30},
        {"time": 0.03, "event": "stop", "origin": "[red]stop button[/red]", "times": 1},
        {"time": 0.04, "event": "state", "origin": "runtime", "state": "FAULT", "faults": ["unseen"]},
        {"time": 0.06, "event": "ticks_missed", "origin": "runtime", "ticks": 3, "in_all": 5},
        {"time": 0.07, "event": "ticks_missed", "origin": "runtime", "ticks": 2, "in_all": 7},
        {"time": "never", "event": 7, "times": "many"},
    ]
    (tmp_path / "events.jsonl").write_text(json.dumps({"time": -2, "event": "law", "origin": "browser 1"}) + "\n")

    class Talking(Played):
        def read(self, most: int = 2000) -> tuple[Run, int]:
            if len(self._blocks) == 2:
                with (tmp_path / "events.jsonl").open("a") as file:
                    file.writelines(f"{json.dumps(event)}\n" for event in happened)
            return super().read(most)

    live.record(Talking(run, twin.inst, [50, (10, 90), (7, 200)]), tmp_path, tmp_path / "run.mcap")
    code, out, _ = tenodesis("info", "run.mcap")
    assert code == 0
    shown = shown_by(out)
    assert shown["in force"] == "law by browser 1"
    assert shown["state"].startswith("FAULT at the end (ENABLED ")
    assert shown["faults"] == f"unseen from 0.04 s, not_a_number from {first:.6g} s"
    assert shown["lost rows"] == f"17: 10 after {run.time[49]:.6g} s, 7 after {run.time[149]:.6g} s"
    assert shown["given up"] == "5: 3 until 0.06 s, 2 until 0.07 s"
    assert (shown["lost events"], shown["corrected"]) == ("none", "none")
    assert shown["ended"] == f"the runtime has ended, at {run.time[356]:.6g} s"
    rows = [line.split("  ") for line in out.splitlines()]
    table = [[cell.strip() for cell in row if cell.strip()] for row in rows]
    assert ["hand", "browser 1", "42", "0.01 s", "0.02 s"] in table
    assert ["stop", "[red]stop button[/red]", "1", "0.03 s", "0.03 s"] in table
    assert ["ticks_missed", "runtime", "2", "0.06 s", "0.07 s"] in table
    assert any(row[:3] == ["7", "unknown", "1"] for row in table)


def test_info_of_a_recording_broken_off_says_so_and_of_one_that_is_not_live_nothing(
    tenodesis: Command, tmp_path: Path
) -> None:
    tenodesis("record", "scaled-up", "short.toml", "--out", "run.mcap")
    assert "in force" not in tenodesis("info", "run.mcap")[1]
    metadata = {"mode": "live"}
    with Recorder(tmp_path / "live.mcap", axes=("yaw",), metadata=metadata) as recorder:
        recorder.write(Run(np.arange(10) * 1e-3, ("yaw",), force=np.ones(10)))
        for n in range(7):
            recorder.event(n * 1e-3, {"event": "rows_lost", "origin": "recorder", "rows": 1 + n})
    shown = shown_by(tenodesis("info", "live.mcap")[1])
    assert shown["lost rows"].startswith(
        "28: 1 after 0 s, 2 after 0.001 s, 3 after 0.002 s, 4 after 0.003 s, 2 times more"
    )
    assert shown["lost rows"].endswith("2 times more, 7 after 0.006 s")
    assert shown["ended"] == "unknown: the recording was broken off"
    assert shown["faults"] == "none"


@pytest.mark.process
def test_ctrl_c_leaves_a_readable_recording_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "long.toml").write_text('name = "long"\n[[phases]]\nkind = "hold"\nduration = "3000 s"\n')
    process = start_command(tmp_path, "record", "scaled-up", "long.toml", "--out", "run.mcap")
    path = tmp_path / "run.mcap"
    until(lambda: path.exists() and path.stat().st_size > 100_000, process)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.damage is None
    assert err.strip() == (
        f"tenodesis: interrupted; run.mcap holds the run up to there, {recording.run.time[-1]:.6g} s, "
        f"{len(recording.run)} rows."
    )


def test_on_eighty_columns_nothing_is_cut_off(
    tenodesis: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tenodesis("record", "scaled-up", "short.toml", "--law", "robust", "--out", "run.mcap")
    monkeypatch.setattr(common.console, "width", 80)
    shown = tenodesis("info", "run.mcap")[1]
    assert "…" not in shown
    assert "sensor_msgs/msg/JointState" in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_a_ctrl_c_that_was_dropped_amid_a_callback_ends_a_command_at_its_next_progress(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bar = common.ProgressBar("reading")
    bar(1, 2)
    monkeypatch.setattr(interrupts, "CAME", [signal.SIGINT])
    with pytest.raises(KeyboardInterrupt):
        bar(2, 2)
