"""Claims about the report on the paper's instruments, computed once, and chapters of it run again from a shell."""

import csv
import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.paper import run
from tenodesis.paper.context import Context
from tenodesis.paper.run import steps
from tenodesis.recording import Recording
from tenodesis.recording.replay import replay

from .conftest import ROOT

pytestmark = pytest.mark.slow

SEEDS = 3
"""Of the campaign; the report takes more."""

Report = tuple[Path, Context, list[str]]


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Report:
    out = tmp_path_factory.mktemp("paper")
    progress: list[str] = []
    context = run(tn.load("real-size"), tn.load("scaled-up"), out, progress.append, seeds=SEEDS)
    return out, context, progress


def test_every_figure_of_the_paper_is_there_as_svg_png_and_csv(paper: Report) -> None:
    out, _, _ = paper
    for name in (
        "fig7_input_output",
        "fig8_tension",
        "fig9_transmissibility",
        "fig11_loss",
        "fig15_compensated",
        "fig14_compensated",
    ):
        assert (out / f"figures/{name}.svg").read_text().startswith("<?xml")
        assert (out / f"figures/{name}.png").read_bytes().startswith(b"\x89PNG")
        assert list(csv.DictReader((out / f"curves/{name}.csv").open()))
    assert {one.stem for one in (out / "figures").glob("*.svg")} == {one.stem for one in (out / "curves").iterdir()}
    assert {entry.name for entry in out.iterdir()} == {"curves", "figures", "recordings", "report.html", "results.json"}


def test_the_report_needs_nothing_beside_it_and_holds_every_figure(paper: Report) -> None:
    out, _, _ = paper
    html = (out / "report.html").read_text("utf-8")
    assert not re.search(r"""(?:src|href)=["'](?!#|data:)""", html.replace("xlink:href", "href"))
    assert "<script" not in html
    assert html.count("<svg") == len(list((out / "figures").glob("*.svg")))
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    for target in re.findall(r'href="#([^"]+)"', html):
        assert target in ids
    for number in range(1, 10):
        assert f"Care point {number}:" in html
    assert "nan" not in re.sub(r"<svg.*?</svg>|<style.*?</style>", "", html, flags=re.S).lower().replace("nano", "")


def test_results_stand_by_name_with_unit_and_published_value(paper: Report) -> None:
    out, context, _ = paper
    results = json.loads((out / "results.json").read_text("utf-8"))
    assert results["schema"] == 1
    entries = results["results"]
    assert set(entries) == set(context.results)
    assert all(entry["unit"] and entry["description"] for entry in entries.values())
    stiffness = entries["table1.stiffness.instrument"]
    assert stiffness["published"] == 31172
    assert abs(stiffness["residual"]) < 0.5
    assert entries["care.1.remaining_share"]["value"] == pytest.approx(0.5, abs=1e-9)
    assert entries["verification.scipy.instrument"]["value"] < np.degrees(1e-9)
    assert entries["verification.mujoco.instrument"]["value"] < 0.05
    assert abs(entries["care.9.radial.mujoco"]["value"] - entries["care.9.radial.virtual_work"]["value"]) < 1e-5


def test_the_recordings_are_the_runs_of_the_figures_and_can_be_replayed(paper: Report) -> None:
    out, context, _ = paper
    assert {path.stem for path in (out / "recordings").iterdir()} == set(context.recordings)
    for name in ("fig14_1N", "fig15_33deg"):
        recording = Recording.open(out / f"recordings/{name}.mcap")
        for signal, values in context.recordings[name].run.signals().items():
            assert np.array_equal(recording.run[signal], values, equal_nan=True)
        again = replay(recording).run
        assert np.array_equal(again["measured_output_angle"], recording.run["measured_output_angle"])


def test_the_robust_law_brings_the_tip_back_in_every_state_whatever_friction_it_assumes(paper: Report) -> None:
    _, context, _ = paper
    figures = {
        key.rpartition(".")[2]: result.value
        for key, result in context.results.items()
        if key.startswith("campaign.step_load.")
    }
    assert figures["final_error_rms"] <= 0.3
    assert figures["final_error_worst"] <= 0.7
    assert figures["time"] <= 3
    assert figures["excursion"] <= 1
    assert figures["tension"] <= 80
    assert figures["observer_error_rms"] <= 0.3
    assert figures["friction_error"] <= 10


def test_the_robust_law_beats_the_others_at_every_held_state(paper: Report) -> None:
    _, context, _ = paper
    for state in ("0", "33", "67", "80"):
        left = {
            law: abs(context.results[f"compensated.{law}.final_error_at_{state}deg"].value)
            for law in ("off", "paper", "exact", "robust")
        }
        assert left["robust"] < min(left["paper"], left["exact"]) < left["off"]
        assert left["exact"] == pytest.approx(left["paper"], abs=0.01)  # nothing slackens here


def test_eq_22_as_a_set_point_of_both_motors_does_most_of_what_fig_15_shows(paper: Report) -> None:
    _, context, _ = paper
    start, end = "compensated.readings.", ".agreement"
    agreement = {
        key.removeprefix(start).removesuffix(end): result.value
        for key, result in context.results.items()
        if key.startswith(start) and key.endswith(end)
    }
    assert {key for key, held in agreement.items() if held == max(agreement.values())} == {
        "set_point.differential.fast",
        "set_point.differential.slow",
    }
    of = {key.removeprefix(start): result.value for key, result in context.results.items() if key.startswith(start)}
    assert of["set_point.agonist.fast.final_error_at_0deg"] < -3
    # It overshoots until a tendon hangs; then the motors let go.
    assert min(of[f"feedback.differential.fast.overshoot_at_{state}deg"] for state in (0, 33, 67, 80)) > 20
    late = [of[f"set_point.differential.slow.delay_at_{state}deg"] for state in (0, 33, 67, 80)]
    assert late == sorted(late)
    assert late[-1] > 2


def test_with_the_robust_law_the_tip_follows_the_cycles_of_fig_14(paper: Report) -> None:
    _, context, _ = paper
    for force in ("0.5", "1", "1.5"):
        ratio = {
            key: context.results[f"compensated_cycles.ratio.{key}.at_{force}N"].value
            for key in ("off", "paper_one_motor", "paper")
        }
        assert ratio["off"] >= 8
        assert ratio["paper_one_motor"] >= 4
        assert ratio["paper"] > 2


def test_fast_wrist_motion_neither_makes_the_robust_law_oscillate_nor_tightens_the_tendons(paper: Report) -> None:
    _, context, _ = paper
    for force in (0, 1):
        key = f"compensated_cycles.wrist.{{}}.robust.at_{force}N"
        assert context.results[key.format("growth")].value == pytest.approx(1, abs=0.15)
        assert abs(context.results[key.format("mean_tension_growth")].value) < 0.1
        off = context.results[f"compensated_cycles.wrist.rmse.off.at_{force}N"].value
        assert context.results[key.format("rmse")].value < off


def test_the_scaled_up_bench_predicts_the_real_size_instrument_with_friction(paper: Report) -> None:
    results = paper[1].results
    trips = [result.value for key, result in results.items() if re.fullmatch(r"round_trip\..*\.rms", key)]
    assert max(trips) <= 0.3


def test_other_designs_beat_the_papers_scaled_up_instrument(paper: Report) -> None:
    results = paper[1].results
    assert results["design.paper.beaten_by"].value > 0
    for name in ("similarity_error", "overall_length", "force_resolution"):
        own, rival = (results[f"design.paper.{of}{name}"].value for of in ("", "rival."))
        assert rival <= own * (1 + 1e-6), name
    margin = results["design.paper.tension_margin"].value
    assert results["design.paper.rival.tension_margin"].value >= margin * (1 - 1e-6)
    assert results["design.paper.similarity_error"].value == pytest.approx(
        results["similarity.scaled.to_0.52N.largest"].value, abs=2e-3
    )
    assert results["design.stock_best.similarity_error"].value <= 0.1
    assert results["design.stock.examined"].value >= 1e6


def test_with_friction_a_pretension_that_is_not_scaled_costs_more_than_statics_predict(paper: Report) -> None:
    results = paper[1].results
    scaled, used = (
        results[f"similarity_with_friction.{name}.fig14.at_rest.rms"].value for name in ("scaled", "as_used")
    )
    assert scaled < 0.1
    assert used > 10 * scaled
    assert results["causes.as_used.with_friction.T_o/(kr).rms"].value > 0.9 * used


def test_missed_targets_are_named_with_their_reasons(paper: Report) -> None:
    out, context, _ = paper
    html = (out / "report.html").read_text("utf-8")
    assert context.results["campaign.straightening.friction_error"].value > 10
    assert "Missed targets and the reasons" in html
    assert "the controller does not measure the bend" in html


def test_the_results_in_the_docs_are_those_of_the_report(paper: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their names, units, meanings and published numbers; values are those of more seeds."""
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    generate = import_module("generate")
    kept = generate.figures.read()["bench"].rows
    now = generate.report(paper[1]).rows
    assert {name: row[1:] for name, row in kept.items()} == {name: row[1:] for name, row in now.items()}, "make docs"


def test_progress_reaches_its_announced_end(paper: Report) -> None:
    _, context, progress = paper
    assert len(progress) == steps(context.inst, context.scaled)


@pytest.mark.process
def test_a_second_run_from_a_shell_gives_the_same_figures_and_says_where(paper: Report, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tenodesis.cli", "bench", "--only", "loss,similarity,step-load"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert "out/report.html" in done.stdout
    assert "table1.stiffness.instrument" in done.stdout
    out, new = paper[0], tmp_path / "out"
    first, second = (json.loads((folder / "results.json").read_text("utf-8"))["results"] for folder in (out, new))
    assert [key for key in second if first[key] != second[key]] == []
    files = sorted(path.relative_to(new) for path in new.rglob("*") if path.suffix in (".csv", ".svg", ".mcap"))
    assert {file.suffix for file in files} == {".csv", ".svg", ".mcap"}
    for file in files:
        assert (new / file).read_bytes() == (out / file).read_bytes(), file
