"""Claims about what a recorder keeps of its rows: `info` says the same by it, and does not believe what is not so."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import tenodesis as tn
from tenodesis.live import event_summary
from tenodesis.recording import Recorder, Recording, kept, summary
from tenodesis.recording.metadata import metadata_of
from tenodesis.recording.outcome import Seen
from tenodesis.run import Run

ROWS = 9000


@pytest.fixture(scope="module")
def run() -> Run:
    """More rows than two blocks have, a not-a-number of a load cell among them."""
    twin = tn.twin.Twin(tn.load("scaled-up"), seed=3)
    fault = tn.simulate.FaultInjection("tension.agonist", "set", np.nan, start=3.1, stop=3.2)
    angle = 0.1 * np.sin(np.arange(ROWS) / 500)
    return twin.run(angle, controller=tn.control.Controller(twin.inst), fault_injection=[fault])


def written(path: Path, run: Run) -> Path:
    inst = tn.load("scaled-up")
    metadata = metadata_of(inst, controller=tn.control.Controller(inst))
    with Recorder(path, axes=run.names, metadata=metadata, start_time=7) as recorder:
        for start in range(0, ROWS, 170):
            recorder.write(run.rows(start, start + 170))
            if start % 3400 == 0:
                recorder.event(1.0, {"event": "law", "origin": f"browser {start}"})
    return path


def said(path: Path) -> tuple[str, dict[str, Any]]:
    found = summary.read(path)
    console = Console(width=120)
    with console.capture() as capture:
        console.print(summary.describe(found), event_summary.describe(found))
    return capture.get(), summary.contents(found)


def test_info_says_the_same_by_what_is_kept_as_by_the_rows(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "run.mcap", run)
    assert kept.read(path) is not None
    by_it = said(path)
    monkeypatch.setattr(kept, "read", lambda *_: None)
    assert by_it == said(path)
    assert by_it[1]["rows"] == ROWS
    assert by_it[1]["events"] == 3
    assert "not_a_number from 3.1" in by_it[1]["origin"]["faults"]


def changed(**values: Any) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    return lambda content: {**content, **values}


@pytest.mark.parametrize(
    "change",
    [
        changed(rows=ROWS - 1),
        changed(channels={}),
        changed(ranges=None),
        lambda content: {name: value for name, value in content.items() if name != "step"},
    ],
    ids=["rows", "channels", "ranges", "step"],
)
def test_what_does_not_fit_the_file_is_not_believed(
    change: Callable[[Mapping[str, Any]], dict[str, Any]], run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = kept.Keeper.texts
    monkeypatch.setattr(
        kept.Keeper, "texts", lambda *given: {"json": json.dumps(change(json.loads(texts(*given)["json"])))}
    )
    path = written(tmp_path / "run.mcap", run)
    assert kept.read(path) is None
    assert said(path)[1]["rows"] == ROWS


def test_a_file_damaged_cut_off_or_of_another_version_is_read_row_by_row(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "run.mcap", run)
    whole = path.read_bytes()
    for share in (0.3, 0.7):
        place = int(share * len(whole))
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert kept.read(path) is None
        assert said(path)[1]["damage"] is not None
        path.write_bytes(whole[:place])
        assert kept.read(path) is None
    path.write_bytes(whole)
    monkeypatch.setattr(kept, "__version__", "another")
    assert kept.read(path) is None


def test_rows_are_written_whatever_is_wrong_with_what_is_kept(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ValueError

    monkeypatch.setattr(Seen, "add", fail)
    path = written(tmp_path / "run.mcap", run)
    assert kept.read(path) is None
    found = Recording.open(path)
    assert (len(found.run), found.damage) == (ROWS, None)
