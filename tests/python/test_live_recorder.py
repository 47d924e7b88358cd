"""Claims about the recorder process: what it was given is in the file, and what is missing is reported."""

import io
import json
import math
import signal
import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import tenodesis as tn
from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument
from tenodesis.live import recorder as live
from tenodesis.live.events import Tail
from tenodesis.live.ticks import Reader
from tenodesis.recording import Recorder, Recording
from tenodesis.run import Names, Run

from .conftest import ROOT, refused, until
from .live_loop import LiveLoop, Played
from .test_recording import bits

STEP = 5e-4


@pytest.fixture(scope="module")
def run() -> Run:
    """A fifth of a second of the scaled-up twin under its controller."""
    twin = tn.twin.Twin(tn.load("scaled-up"), seed=3)
    return twin.run(np.linspace(0, 0.06, 400), force=0.5, controller=tn.control.Controller(twin.inst))


def slow(folder: Path, path: Path, *, seconds: float, before: str = "") -> subprocess.Popen[str]:
    """Start a recorder process whose source gives rows of some seconds, by the clock; every 400th row is lost."""
    program = f"""
import sys, time
from pathlib import Path
import numpy as np
import tenodesis as tn
from tenodesis.live import recorder
from tenodesis.run import Names, Run
{before}
class Source:
    inst, names, time_step = tn.load("scaled-up"), Names.paired(["yaw"]), {STEP}
    row, begun = 1, time.monotonic()
    @property
    def alive(self):
        return self.row * {STEP} < {seconds}
    def read(self, most=2000):
        due = min(int((time.monotonic() - self.begun) / {STEP}), self.row + most)
        rows = np.arange(self.row, due)
        self.row = max(due, self.row)
        kept = rows[rows % 400 != 0]
        t = kept * {STEP}
        return Run(t, ("yaw",), force=np.sin(t), measured_tension=np.stack([t, -t], 1)), rows.size - kept.size
folder, path = Path({str(folder)!r}), Path({str(path)!r})
sys.exit(recorder.supervise(lambda stop: recorder.record(Source(), folder, path, stop=stop)))
"""
    return subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True, cwd=ROOT)


def status_when(folder: Path, enough: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Wait until the recorder says that it is far enough."""
    file, status = folder / live.STATUS, {}

    def is_enough() -> bool:
        status.update(json.loads(file.read_text()) if file.exists() else {})
        return bool(status) and enough(status)

    until(is_enough)
    return status


def check_slow(recorded: Run) -> None:
    """Check that the rows are those that `slow` gives, from the first on, and no others."""
    rows = np.rint(recorded.time / STEP).astype(int)
    assert recorded.time.tolist() == (rows * STEP).tolist()
    expected = np.arange(1, rows[-1] + 1)
    assert rows.tolist() == expected[expected % 400 != 0].tolist()
    assert recorded.force is not None
    assert recorded.force.tolist() == np.sin(recorded.time).tolist()


def test_all_rows_are_recorded_bit_by_bit_with_what_they_are_of(run: Run, tmp_path: Path) -> None:
    before = datetime.now(UTC)
    inst = tn.load("scaled-up")
    outcome = live.record(Played(run, inst, [1, 0, 159, 0, 240]), tmp_path, tmp_path / "run.mcap", device="twin")
    recording = Recording.open(tmp_path / "run.mcap")
    assert bits(recording.run) == bits(run)
    assert recording.damage is None
    assert recording.instrument() == inst
    assert recording.topics["/controller/measured_cf"].messages == len(run)
    assert {key: recording.metadata[key] for key in ("mode", "device", "rate", "time_step")} == {
        "mode": "live",
        "device": "twin",
        "rate": "2000 Hz",
        "time_step": "0.0005",
    }
    assert (outcome.rows, outcome.lost, outcome.corrected, outcome.complaint) == (400, 0, 0, None)
    assert outcome.seconds == run.time[-1] - run.time[0]
    # Stamps are the time of day, counted from the first rows that came.
    started = datetime.fromisoformat(recording.metadata["start_time"])
    assert before.timestamp() - 1e-3 <= started.timestamp() + run.time[0] <= datetime.now(UTC).timestamp() + 1e-3
    with (tmp_path / "run.mcap").open("rb") as file:
        first = min(message.log_time for _, channel, message in make_reader(file).iter_messages(topics=["/time"]))
    assert first / 1e9 == pytest.approx(started.timestamp() + run.time[0], abs=2e-6)


def test_events_are_recorded_in_order_with_their_origin_and_for_stock_tools(run: Run, tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    happened = [
        {"time": 0.05, "event": "command", "origin": "page 3", "force": [0.5]},
        {"time": 0.1, "event": "fault", "faults": ["tension_sensor"]},
        {"event": "operator", "origin": "Jörg\u2028 \ud83d\ude00"},
    ]

    class Talking(Played):
        def read(self, most: int = 2000) -> tuple[Run, int]:
            if len(self._blocks) == 1:
                lines = "".join(f"{json.dumps(event)}\n" for event in happened)
                events.write_text(f"{lines}no json\n[1]\n")
            return super().read(most)

    live.record(Talking(run, tn.load("scaled-up"), [200, 200]), tmp_path, tmp_path / "run.mcap")
    recorded = Recording.open(tmp_path / "run.mcap").events
    assert [(event.time, dict(event.content)) for event in recorded[:2]] == [
        (0.05, {"event": "command", "origin": "page 3", "force": [0.5]}),
        (0.1, {"event": "fault", "faults": ["tension_sensor"]}),
    ]
    assert recorded[2].content == {"event": "operator", "origin": "Jörg\u2028 \U0001f600"}
    assert recorded[2].time == run.time[-1]
    assert [event.content.get("line") for event in recorded[3:5]] == ["no json", "[1]"]
    assert recorded[5].content["event"] == "recording_ended"
    assert recorded[5].content["why"] == "the runtime has ended"
    with (tmp_path / "run.mcap").open("rb") as file:
        found = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(["/events"]))
    assert {schema.name for schema, *_ in found if schema is not None} == {"std_msgs/msg/String"}
    assert [json.loads(message.data) for *_, message in found][:2] == happened[:2]


def test_what_was_in_force_before_is_recorded_once_with_since_when(run: Run, tmp_path: Path) -> None:
    lines = [{"time": -1 + n / 4e3, "event": ("law", "operator")[n % 2], "n": n} for n in range(4000)]
    (tmp_path / "events.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    live.record(Played(run, tn.load("scaled-up"), [400]), tmp_path, tmp_path / "run.mcap")
    events = Recording.open(tmp_path / "run.mcap").events
    assert [(event.content["event"], event.content.get("n")) for event in events] == [
        ("law", 3998),
        ("operator", 3999),
        ("recording_ended", None),
    ]
    assert [event.content.get("since") for event in events[:2]] == [lines[3998]["time"], lines[3999]["time"]]
    assert events[0].time == pytest.approx(run.time[0], abs=1e-8)


def test_lost_rows_are_told_where_they_are_missing(run: Run, tmp_path: Path) -> None:
    blocks = [50, (10, 90), 0, (7, 200)]
    outcome = live.record(Played(run, tn.load("scaled-up"), blocks), tmp_path, tmp_path / "run.mcap")
    kept = np.r_[0:50, 60:150, 157:357]
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.damage is None
    assert recording.run.time.tolist() == run.time[kept].tolist()
    lost = [event for event in recording.events if event.content["event"] == "rows_lost"]
    assert [(event.time, event.content["rows"], event.content["in_all"]) for event in lost] == [
        (run.time[49], 10, 10),
        (run.time[149], 7, 17),
    ]
    assert outcome.lost == 17
    assert outcome.complaint == "17 rows are missing, for the recorder was too slow."
    assert json.loads((tmp_path / live.STATUS).read_text())["lost"] == 17


def test_rows_whose_time_does_not_go_on_are_kept_and_told(run: Run, tmp_path: Path) -> None:
    times = run.time.copy()
    times[10:13] = times[9]
    times[50:60] = times[20]
    times[100] = math.nan
    times[390:] = -math.inf
    source = Played(replace(run, time=times), tn.load("scaled-up"), [55, 345])
    outcome = live.record(source, tmp_path, tmp_path / "run.mcap")
    recorded = Recording.open(tmp_path / "run.mcap").run
    assert len(recorded) == 400
    assert outcome.corrected == 24
    assert outcome.complaint == "24 rows came with a time that did not go on."
    right = np.setdiff1d(np.arange(400), [*range(10, 13), *range(50, 60), 100, *range(390, 400)])
    assert recorded.time[right].tolist() == run.time[right].tolist()
    assert (np.diff(recorded.time) > 0).all()
    events = [event.content for event in Recording.open(tmp_path / "run.mcap").events]
    assert [event["rows"] for event in events if event["event"] == "time_corrected"] == [8, 16]


@pytest.mark.process
def test_a_killed_recorder_leaves_all_it_said_was_safe(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    (tmp_path / "events.jsonl").write_text('{"time": 0, "event": "law", "law": "robust"}\n')
    with slow(tmp_path, path, seconds=600) as process:
        status = status_when(tmp_path, lambda status: status.get("rows", 0) > 1500)
        process.kill()
    recording = Recording.open(path)
    assert recording.damage is not None
    assert len(recording.run) >= status["rows"]
    check_slow(recording.run)
    assert recording.metadata["mode"] == "live"
    events = [event.content for event in recording.events]
    assert events[0]["law"] == "robust"
    lost = [event["in_all"] for event in events if event["event"] == "rows_lost"]
    assert lost[-1] >= status["lost"] >= 1500 // 400
    assert not status["ended"]


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_closes_the_recording(number: signal.Signals, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with slow(tmp_path, path, seconds=600) as process:
        status_when(tmp_path, lambda status: status.get("rows", 0) > 500)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    recording = Recording.open(path)
    assert process.returncode == 0
    assert recording.damage is None
    check_slow(recording.run)
    last = recording.events[-1].content
    assert (last["event"], last["why"], last["rows"]) == ("recording_ended", "on request", len(recording.run))
    assert said == f"tenodesis: {last['lost']} rows are missing, for the recorder was too slow.\n"
    status = status_when(tmp_path, lambda status: status["ended"])
    assert (status["rows"], status["problem"]) == (len(recording.run), None)


@pytest.mark.process
def test_a_disk_that_fills_up_ends_it_with_a_sentence_and_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    limit = (
        "import resource, signal\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))\n"
    )
    with slow(tmp_path, path, seconds=600, before=limit) as process:
        _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert said.startswith(f"tenodesis: {path} cannot be written: File too large; what was written")
    assert said.count("\n") == 1
    recording = Recording.open(path)
    check_slow(recording.run)
    promised = int(said.split("at least ")[1].split()[0])
    assert 0 < promised <= len(recording.run)
    status = status_when(tmp_path, lambda status: status["ended"])
    assert f"tenodesis: {status['problem']}\n" == said


@pytest.mark.process
def test_a_file_that_cannot_be_written_is_one_sentence(run: Run, tmp_path: Path) -> None:
    def attempt(path: Path) -> None:
        live.record(Played(run, tn.load("scaled-up"), [400]), tmp_path, path)

    (tmp_path / "old.mcap").write_bytes(b"precious")
    with refused("path", kind=RecordingError, allowed="a path that does not exist"):
        attempt(tmp_path / "old.mcap")
    assert (tmp_path / "old.mcap").read_bytes() == b"precious"
    with refused("path", kind=RecordingError, allowed="in a folder that exists"):
        attempt(tmp_path / "none" / "run.mcap")
    assert "there is no folder" in json.loads((tmp_path / live.STATUS).read_text())["problem"]
    command = [sys.executable, "-m", "tenodesis.live.recorder", str(tmp_path), str(tmp_path / "run.mcap")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, cwd=ROOT)
    assert done.returncode == 1
    assert done.stderr.startswith(f"tenodesis: {tmp_path} is no folder of a live instrument")
    assert done.stderr.count("\n") == 1


def test_it_stops_when_it_is_told_to_before_anything_has_come(scaled: Instrument, run: Run, tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    outcome = live.record(Played(run, scaled, [0] * 1000), tmp_path, tmp_path / "run.mcap", stop=stop)
    recording = Recording.open(tmp_path / "run.mcap")
    assert (outcome.rows, len(recording.run), recording.damage) == (0, 0, None)


@pytest.mark.parametrize(("there", "recorded"), [(9000, 9000), (math.inf, None)])
def test_what_was_there_when_it_was_told_to_stop_is_recorded_and_what_has_no_end_does_not_keep_it(
    scaled: Instrument, tmp_path: Path, there: float, recorded: int | None
) -> None:
    stop = threading.Event()

    class Behind:
        inst, names, time_step, row, alive = scaled, Names.paired(["yaw"]), STEP, 0, True

        def read(self, most: int = 2000) -> tuple[Run, int]:
            stop.set()
            rows = np.arange(self.row, min(self.row + most, there)) + 1
            self.row += rows.size
            return Run(rows * STEP, ("yaw",), force=rows * 1.0), 0

    outcome = live.record(Behind(), tmp_path, tmp_path / "run.mcap", stop=stop)
    # A ring holds eight seconds, or up to twice that.
    assert outcome.rows == recorded or (recorded is None and 16 / STEP <= outcome.rows <= 20 / STEP)
    assert outcome.lost == 0


def test_memory_does_not_grow_with_the_rows(scaled: Instrument, tmp_path: Path) -> None:
    """Ten times the rows take no more memory than the index that a file of so many chunks ends with."""

    class Endless:
        inst, names, time_step, row = scaled, Names.paired(["yaw"]), STEP, 0
        peaks: tuple[int, ...] = ()

        @property
        def alive(self) -> bool:
            return self.row < 60_000

        def read(self, most: int = 2000) -> tuple[Run, int]:
            if self.row in {20_000, 40_000, 60_000}:
                self.peaks += (tracemalloc.get_traced_memory()[1],)
                tracemalloc.reset_peak()
            rows = np.arange(self.row, min(self.row + most, 60_000)) + 1
            self.row += rows.size
            return Run(rows * STEP, ("yaw",), force=rows * 1.0), 0

    source = Endless()
    np.median([0.0])  # loads a module of NumPy at its first call
    tracemalloc.start()
    try:
        live.record(source, tmp_path, tmp_path / "run.mcap")
    finally:
        tracemalloc.stop()
    first, second, third = source.peaks[:3]
    assert third - second < 0.02 * first


def test_a_tail_gives_each_line_once_however_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    tail = Tail(path)
    assert tail.read() == []
    rng = np.random.default_rng(2)
    lines = [json.dumps({"event": "command", "n": n, "text": "ä" * int(rng.integers(0, 50))}) for n in range(300)]
    data = ("\n".join(lines) + "\n").encode()
    cuts = [0, *np.sort(rng.integers(0, len(data), 200)).tolist(), len(data)]
    found = []
    with path.open("ab", buffering=0) as file:
        for start, stop in pairwise(cuts):
            file.write(data[start:stop])
            found += tail.read()
    assert [event.content["n"] for event in found] == list(range(300))
    assert all(math.isnan(event.time) for event in found)


def test_lines_that_are_no_events_are_told_as_such_and_nothing_after_them_is_missed(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    deep = "[" * 100_000
    bad = ["", "   ", "{", "3", '"x"', "null", deep, "x" * 1_000_000, '{"time": 1e999}', f'{{"time": {"9" * 400}}}']
    path.write_bytes("\n".join(bad).encode() + b"\n\xff\xfe\n" + b'{"time": 2, "event": "law"}\n{"time": 3')
    tail, found = Tail(path), []
    for _ in range(20):
        found += tail.read()
    assert found[-1].time == 2.0
    assert found[-1].content == {"event": "law"}
    unreadable = [event for event in found if event.content.get("event") == "unreadable"]
    assert [len(event.content["line"]) <= 200 for event in unreadable] == [True] * len(unreadable)
    assert len(found) == len(bad) - 2 + 2
    with path.open("ab") as file:
        file.write(b"}\n")
    assert [event.time for event in tail.read()] == [3.0]
    assert Tail(path, at_end=True).read() == []


def test_whatever_an_event_says_the_recording_goes_on(run: Run, tmp_path: Path) -> None:
    odd = ['{"time": 1e300}', '{"time": -5}', '{"time": NaN, "x": NaN}', '{"time": true}', '{"time": "1"}']
    odd += ['{"event": ["a"], "x": "\\ud800"}', '{"x": "\\u0000"}']

    class Odd(Played):
        def read(self, most: int = 2000) -> tuple[Run, int]:
            (tmp_path / "events.jsonl").write_text("".join(f"{line}\n" for line in odd))
            return super().read(most)

    live.record(Odd(run, tn.load("scaled-up"), [200, 200]), tmp_path, tmp_path / "run.mcap")
    recording = Recording.open(tmp_path / "run.mcap")
    assert bits(recording.run) == bits(run)
    assert len(recording.events) == len(odd) + 1
    assert recording.events[-2].content == {"x": "\0"}


def test_an_event_reaches_the_disk_without_rows(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", axes=("yaw",))
    recorder.event(1.5, {"event": "fault"})
    assert Recording.open(tmp_path / "run.mcap").events == ()
    recorder.flush()
    recording = Recording.open(tmp_path / "run.mcap")
    assert [(event.time, event.content) for event in recording.events] == [(1.5, {"event": "fault"})]
    for time_, content, said in (
        (math.nan, {}, "time of an event = nan"),
        (0.0, {"x": {1}}, "cannot be written as JSON"),
    ):
        with pytest.raises(RecordingError, match=said):
            recorder.event(time_, content)
    recorder.close()
    recorder.flush()
    with pytest.raises(RecordingError, match="is closed"):
        recorder.event(2.0, {})


def test_events_after_a_missing_one_are_not_read(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap", axes=("yaw",)) as recorder:
        for n in range(4):
            recorder.write(Run(np.array([n * 1.0]), ("yaw",), force=np.array([1.0])))
            recorder.event(n * 1.0, {"n": n})
            recorder.flush()
    data = (tmp_path / "run.mcap").read_bytes()
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    third, fourth = (summary.chunk_indexes[n].chunk_start_offset for n in (2, 3))
    (tmp_path / "run.mcap").write_bytes(data[:third] + data[fourth:])
    recording = Recording.open(tmp_path / "run.mcap")
    assert len(recording.run) == 2
    assert [event.content["n"] for event in recording.events] == [0, 1]


def test_the_ticks_of_the_loop_itself_are_recorded_and_those_it_overwrote_are_told(tmp_path: Path) -> None:
    loop = LiveLoop(tmp_path, tn.load("scaled-up"), ring="ring", capacity=1024)
    loop.describe_folder()
    loop.ask("enable")
    loop.ticks(100)
    reader = Reader(tmp_path)
    stop = threading.Event()
    loop.load(0.7)
    loop.ticks(900)
    stop.set()
    live.record(reader, tmp_path, tmp_path / "run.mcap", device=reader.about.device, stop=stop)
    recording = Recording.open(tmp_path / "run.mcap")
    assert bits(recording.run) == bits(loop.runs[-1])
    assert recording.run.force is not None
    assert recording.run.force[-1] == 0.7
    loop.ticks(3000)
    outcome = live.record(reader, tmp_path, tmp_path / "lost.mcap", stop=stop)
    assert outcome.lost == 3000 - outcome.rows > 1900
    assert bits(Recording.open(tmp_path / "lost.mcap").run) == bits(loop.runs[-1].rows(outcome.lost, 3000))
