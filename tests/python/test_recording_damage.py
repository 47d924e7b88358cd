"""Claims about damaged recordings: what was written until then comes back, and never anything else."""

import errno
import io
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from tenodesis.errors import RecordingError
from tenodesis.recording import Recorder, Recording
from tenodesis.run import Run

from .conftest import refused
from .recording_samples import a_run, bits, recorded


@pytest.fixture(scope="module")
def run() -> Run:
    return a_run(60)


@pytest.fixture(scope="module")
def whole(run: Run, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A file of six chunks of ten rows."""
    path = recorded(tmp_path_factory.mktemp("whole") / "run.mcap", run, metadata={"seed": "7"}, chunk_seconds=0.005)
    return path.read_bytes()


def check_prefix(path: Path, run: Run) -> Recording | None:
    """Check that a damaged file is refused or gives rows that are right, and says which."""
    try:
        recording = Recording.open(path)
    except RecordingError as problem:
        assert str(path) in str(problem)
        return None
    rows = len(recording.run)
    assert rows % 10 == 0
    if rows:
        assert bits(recording.run) == bits(run, rows)
    if rows < len(run):
        assert recording.damage is not None
        assert str(path) in recording.damage
    return recording


def test_a_truncated_file_reads_up_to_its_last_closed_chunk(whole: bytes, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    found = []
    for size in [*range(0, 40), *range(40, len(whole), len(whole) // 60), len(whole) - 1]:
        path.write_bytes(whole[:size])
        recording = check_prefix(path, run)
        found.append(-1 if recording is None else len(recording.run))
        if recording is not None:
            assert recording.metadata["seed"] == "7"
            assert recording.damage is not None
    assert found == sorted(found)
    assert set(found) == {-1, 0, 10, 20, 30, 40, 50, 60}


def test_a_corrupted_byte_never_makes_wrong_rows(whole: bytes, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "corrupt.mcap"
    rng = np.random.default_rng(5)
    for position in [*range(8, 60), *rng.integers(60, len(whole), 80)]:
        corrupt = bytearray(whole)
        corrupt[position] ^= int(rng.integers(1, 256))
        path.write_bytes(corrupt)
        check_prefix(path, run)


def test_a_corrupted_chunk_ends_the_recording_before_it(whole: bytes, run: Run, tmp_path: Path) -> None:
    summary = make_reader(io.BytesIO(whole)).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[3]
    corrupt = bytearray(whole)
    corrupt[chunk.chunk_start_offset + chunk.chunk_length - 20] ^= 1
    path = tmp_path / "corrupt.mcap"
    path.write_bytes(corrupt)
    recording = check_prefix(path, run)
    assert recording is not None
    assert len(recording.run) == 30
    assert recording.damage == (
        f"{path} is read up to 0.0145 s (30 rows) only: the chunk at byte {chunk.chunk_start_offset} is corrupted."
    )


def test_a_missing_chunk_ends_the_recording_before_it(whole: bytes, run: Run, tmp_path: Path) -> None:
    summary = make_reader(io.BytesIO(whole)).get_summary()
    assert summary is not None
    third, fourth = (summary.chunk_indexes[i].chunk_start_offset for i in (2, 3))
    path = tmp_path / "gap.mcap"
    path.write_bytes(whole[:third] + whole[fourth:])
    recording = check_prefix(path, run)
    assert recording is not None
    assert len(recording.run) == 20


def test_a_changed_byte_of_metadata_is_noticed(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "changed.mcap"
    path.write_bytes(whole.replace(b"seed\1\0\0\x007", b"seed\1\0\0\x008", 1))
    recording = Recording.open(path)
    assert "metadata" in str(recording.damage)
    assert len(recording.run) == 60


@pytest.mark.process
def test_a_killed_process_leaves_what_it_recorded(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    program = (
        "import itertools, sys, numpy as np\n"
        "from tenodesis.recording import Recorder\n"
        "from tenodesis.run import Run\n"
        "recorder = Recorder(sys.argv[1], axes=('yaw',), chunk_seconds=0.05)\n"
        "for block in itertools.count():\n"
        "    time = (block * 100 + np.arange(100)) * 0.0005\n"
        "    recorder.write(Run(time, ('yaw',), force=time, tension=np.stack([time, -time], 1)))\n"
        "    print(block, flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process:
        for _ in range(6):
            process.stdout.readline()
        process.send_signal(signal.SIGKILL)
    recording = Recording.open(path)
    run = recording.run
    assert recording.damage is not None
    assert len(run) >= 500
    assert run.tension is not None
    assert run.time.tolist() == (np.arange(len(run)) * 0.0005).tolist()
    assert run.tension.tolist() == np.stack([run.time, -run.time], 1).tolist()


class FullDisk(io.FileIO):
    room = 0

    def write(self, data: Any) -> int:
        fits = bytes(data)[: self.room]
        self.room -= len(fits)
        if not fits:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(fits)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.97])
def test_on_a_full_disk_the_chunks_before_remain(
    share: float, whole: bytes, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "full.mcap"

    def opened(path: Path, mode: str) -> io.BufferedWriter:
        raw = FullDisk(path, mode)
        raw.room = int(share * len(whole))
        return io.BufferedWriter(raw)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", opened)
        recorder = Recorder(path, axes=("yaw",), metadata={"seed": "7"}, chunk_seconds=0.005)
    with pytest.raises(
        RecordingError, match=r"No space left on device; .* remains readable: at least \d+ rows"
    ) as problem:
        for start in range(0, 60, 10):
            recorder.write(run.rows(start, start + 10))
        recorder.close()
    recording = Recording.open(path)
    promised = int(str(problem.value).split("at least ")[1].split()[0])
    assert 0 < promised <= len(recording.run) <= promised + 10
    assert bits(recording.run) == bits(run, len(recording.run))
    recorder.close()
    with pytest.raises(RecordingError, match="is closed"):
        recorder.write(a_run(1, start=100))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_disk_that_is_full_from_the_start_is_an_error() -> None:
    with refused("path", kind=RecordingError):
        Recorder("/dev/full", axes=("yaw",), overwrite=True)
