"""Claims about what a prompt and a notebook show of the package's objects."""

import html
import shutil
import subprocess
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument
from tenodesis.run import Run

from .test_identification import line

LONGEST = 330
"""Characters: four lines of a terminal of 80 columns, with a little over for names."""


@cache
def things() -> dict[str, Any]:
    scaled = tn.load("scaled-up")
    twin, controller = tn.twin.Twin(scaled), tn.control.Controller(scaled)
    run = twin.run(np.full(200, 0.1), np.full(200, 0.5), controller=controller)
    front = tn.scaling.design("real-size", combinations=2000)
    comparison = tn.similarity.compare("real-size", scaled)
    study = tn.tolerance.study("real-size", scaled, samples=8)
    random = np.random.default_rng(1)
    return {
        "instrument": scaled,
        "run": run,
        "step": twin.step(0.1),
        "two axes": tn.twin.Twin("real-size").run(np.zeros((3, 2))),
        "twin": twin,
        "batch": tn.twin.run_many(scaled, np.zeros(20), vary={"pretension": [20.0, 25.0]}),
        "controller": controller,
        "protocol": tn.simulate.load("tissue"),
        "front": front,
        "design": front[0],
        "comparison": comparison,
        "similarity error": comparison.error(grid=(5, 3)),
        "error at rest": comparison.error_at_rest(forces=[0.5]),
        "study": study,
        "response": next(iter(study.responses.values())),
        "fit": tn.identification.fit(line([random.normal(size=200)]), train=[0], starts=1),
    }


@pytest.mark.slow
def test_every_object_is_shown_in_a_few_lines() -> None:
    for name, thing in things().items():
        if name != "comparison":
            shown = repr(thing)
            assert len(shown) <= LONGEST, name
            assert "\n" not in shown, name
            assert "array(" not in shown, name


def test_an_instrument_is_shown_by_its_name_and_main_dimensions(real: Instrument) -> None:
    assert repr(real).startswith("<TendonGear 'real-size': yaw and pitch, overall_length 500 mm, pretension 30 N, ")
    assert str(real) == repr(real)


def test_a_recording_is_shown_by_its_file_and_its_run(scaled: Instrument, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    run = tn.twin.Twin(scaled).run(np.zeros(20))
    with tn.Recorder(path, axes=run.axes) as recorder:
        recorder.write(run)
    shown = repr(tn.Recording.open(path))
    assert shown.startswith(f"<Recording {str(path)!r}: <Run of 20 rows, 0.0005 to 0.01 s, yaw, ")


class Checked(HTMLParser):
    """Collects the tags, attributes and cells of a table."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.cells: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        if tag == "td":
            self.cells.append("")

    def handle_data(self, data: str) -> None:
        if self.cells:
            self.cells[-1] += data


def parsed(thing: Any) -> Checked:
    checked = Checked()
    checked.feed(thing._repr_html_())
    assert checked.tags <= {"table", "caption", "thead", "tbody", "tr", "th", "td"}
    assert checked.attributes <= {"style"}
    return checked


def test_a_notebook_shows_an_instrument_in_units_of_drawings(real: Instrument) -> None:
    cells = parsed(real).cells
    assert cells[cells.index("distal_gear_radius") + 1] == "2 mm"
    assert cells[cells.index("handle_range") + 1] == "45 deg"
    assert cells[cells.index("friction") + 1] == "capstan"


def test_text_of_a_file_is_no_markup_in_a_notebook(real: Instrument) -> None:
    name = "<script>alert(1)</script>"
    shown = real.replace(name=name, sources={"pretension": "<img src=x>"})._repr_html_()
    assert name not in shown
    assert "<img" not in shown
    assert html.escape(name) in shown


def test_a_notebook_shows_every_signal_of_a_run(scaled: Instrument) -> None:
    run = tn.twin.Twin(scaled).run(np.linspace(0, 0.1, 50))
    cells = parsed(run).cells
    assert [cells[n] for n in range(0, len(cells), 6)] == list(run.signals())
    at = cells.index("commanded_handle_angle")
    assert cells[at + 1 : at + 5] == ["rad", "0", "0.1", "0.1"]


@pytest.mark.slow
def test_a_notebook_shows_a_front_and_a_fit() -> None:
    front, fit = things()["front"], things()["fit"]
    cells = parsed(front).cells
    assert len(cells) == 6 * min(10, len(front))
    cells = parsed(fit).cells
    assert [cells[n] for n in range(0, len(cells), 6)] == [one.name for one in fit.parameters]


def test_faults_are_named_with_their_time(scaled: Instrument) -> None:
    stuck = tn.simulate.FaultInjection("tension.agonist", "set", value=float("nan"), start=0.05)
    run = tn.twin.Twin(scaled).run(np.zeros(400), controller=tn.control.Controller(scaled), fault_injection=[stuck])
    assert run.fault_times
    assert set(run.fault_times) <= set(tn.control.FAULTS)
    first = next(iter(run.fault_times.values()))
    assert 0.05 <= first < 0.1
    assert first == run.time[np.flatnonzero(run["faults"])[0]]
    assert f"faults: {', '.join(run.fault_times)}" in repr(run)
    assert f"{next(iter(run.fault_times))} from {first:.6g} s" in run._repr_html_()
    assert tn.twin.Twin(scaled).run(np.zeros(5)).fault_times == {}


def test_a_run_is_sliced_by_rows_and_by_times(scaled: Instrument) -> None:
    run = tn.twin.Twin(scaled).run(np.zeros(100))
    assert len(run.rows(10, 20)) == 10
    by_time = run[0.01:0.02]
    assert (by_time.time[0], by_time.time[-1]) == pytest.approx((0.01, 0.02))
    assert len(run[:0.02]) == 40
    assert len(run[0.02:]) == 61
    np.testing.assert_array_equal(run[0.01:0.02:2].time, by_time.time[::2])
    with pytest.raises(tn.ArgumentError, match=r"run\[2:3\] could be rows or seconds; it must be run.rows\(2, 3\)"):
        run[2:3]


def test_a_run_becomes_a_data_frame(scaled: Instrument) -> None:
    pytest.importorskip("pandas")
    run: Run = tn.twin.Twin(scaled).run(np.zeros(10))
    frame = run.to_pandas()
    assert frame.index.name == "time [s]"
    np.testing.assert_array_equal(frame["output_angle.yaw [rad]"], run["output_angle"])


@pytest.mark.process
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium")
def test_a_browser_draws_a_table(real: Instrument, tmp_path: Path) -> None:
    page, picture = tmp_path / "page.html", tmp_path / "page.png"
    page.write_text(f"<meta charset=utf-8>{real._repr_html_()}", "utf-8")
    command = ["chromium", "--headless", "--no-sandbox", f"--user-data-dir={tmp_path / 'profile'}"]
    subprocess.run([*command, f"--screenshot={picture}", page.as_uri()], check=True, capture_output=True, timeout=60)
    assert picture.read_bytes().startswith(b"\x89PNG")
