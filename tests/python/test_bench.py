"""Claims about the bench: what it writes, that it writes all or nothing, and that it works for any mechanism."""

import csv
import json
import re
from importlib import import_module
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument
from tenodesis.paper import BenchError, report, run
from tenodesis.paper.context import Context
from tenodesis.paper.run import steps

from .conftest import ROOT

SEEDS = 3
"""Of the campaign; the report takes more."""


@pytest.fixture(scope="session")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Context, list[str]]:
    out = tmp_path_factory.mktemp("bench")
    told: list[str] = []
    context = run(tn.load("real-size"), tn.load("scaled-up"), out, told.append, seeds=SEEDS)
    return out, context, told


Bench = tuple[Path, Context, list[str]]


def test_every_figure_of_the_paper_is_there_as_svg_png_and_csv(bench: Bench) -> None:
    out, _, _ = bench
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
        rows = list(csv.DictReader((out / f"curves/{name}.csv").open()))
        assert len(rows) > 200
    assert {entry.name for entry in out.iterdir()} == {"curves", "figures", "recordings", "report.html", "results.json"}


def test_the_report_needs_nothing_beside_it_and_holds_every_figure(bench: Bench) -> None:
    out, _, _ = bench
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


def test_curves_are_the_statics_at_their_columns(bench: Bench) -> None:
    out, _, _ = bench
    inst = tn.load("real-size")
    rows = list(csv.DictReader((out / "curves/fig7_input_output.csv").open()))
    for row in rows[::40]:
        for force in (0, 1, 3):
            text = row[f"output_angle at {force} N [deg]"]
            if text:
                angle = tn.statics.output_angle(inst, np.radians(float(row["handle_angle [deg]"])), force)
                assert float(text) == pytest.approx(np.degrees(angle), abs=1e-6)


def test_results_stand_by_name_with_unit_and_published_value(bench: Bench) -> None:
    out, context, _ = bench
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


def test_the_robust_law_brings_the_tip_back_in_every_state_whatever_friction_it_is_told(bench: Bench) -> None:
    _, context, _ = bench
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


def test_the_robust_law_beats_the_others_at_every_held_state(bench: Bench) -> None:
    _, context, _ = bench
    for state in ("0", "33", "67", "80"):
        left = {
            law: abs(context.results[f"compensated.{law}.final_error_at_{state}deg"].value)
            for law in ("off", "paper", "exact", "robust")
        }
        assert left["robust"] < min(left["paper"], left["exact"]) < left["off"]
        assert left["exact"] == pytest.approx(left["paper"], abs=0.01)  # nothing slackens here


def test_eq_22_as_a_set_point_of_both_motors_does_most_of_what_fig_15_shows(bench: Bench) -> None:
    _, context, _ = bench
    start, end = "compensated.readings.", ".agreement"
    agreement = {
        key.removeprefix(start).removesuffix(end): result.value
        for key, result in context.results.items()
        if key.startswith(start) and key.endswith(end)
    }
    assert len(agreement) == 8
    assert {key for key, held in agreement.items() if held == max(agreement.values())} == {
        "set_point.differential.fast",
        "set_point.differential.slow",
    }
    of = {key.removeprefix(start): result.value for key, result in context.results.items() if key.startswith(start)}
    assert of["set_point.agonist.fast.final_error_at_0deg"] < -3
    assert min(of[f"feedback.differential.fast.final_error_at_{state}deg"] for state in (0, 33, 67, 80)) > 20
    late = [of[f"set_point.differential.slow.delay_at_{state}deg"] for state in (0, 33, 67, 80)]
    assert late == sorted(late)
    assert late[-1] > 2


def test_with_the_robust_law_the_tip_follows_the_cycles_of_fig_14(bench: Bench) -> None:
    _, context, _ = bench
    for force in ("0.5", "1", "1.5"):
        ratio = {
            key: context.results[f"compensated_cycles.ratio.{key}.at_{force}N"].value
            for key in ("off", "paper_one_motor", "paper")
        }
        assert ratio["off"] >= 8
        assert ratio["paper_one_motor"] >= 4
        assert ratio["paper"] > 2


def test_a_quick_wrist_neither_shakes_the_robust_law_up_nor_winds_the_tendons_tighter(bench: Bench) -> None:
    _, context, _ = bench
    for force in (0, 1):
        key = f"compensated_cycles.wrist.{{}}.robust.at_{force}N"
        assert context.results[key.format("growth")].value == pytest.approx(1, abs=0.15)
        assert abs(context.results[key.format("mean_tension_growth")].value) < 0.1
        off = context.results[f"compensated_cycles.wrist.rmse.off.at_{force}N"].value
        assert context.results[key.format("rmse")].value < off


def test_the_large_bench_predicts_the_small_instrument_with_friction(bench: Bench) -> None:
    results = bench[1].results
    trips = [result.value for key, result in results.items() if re.fullmatch(r"round_trip\..*\.rms", key)]
    assert len(trips) == 6
    assert max(trips) <= 0.3


def test_the_papers_prototype_is_beaten_by_known_ones(bench: Bench) -> None:
    results = bench[1].results
    assert results["design.paper.beaten_by"].value > 0
    for name in ("similarity_error", "overall_length", "force_resolution"):
        own, rival = (results[f"design.paper.{of}{name}"].value for of in ("", "rival."))
        assert rival <= own * (1 + 1e-6), name
    assert results["design.paper.similarity_error"].value == pytest.approx(
        results["similarity.scaled.to_0.52N.largest"].value, abs=2e-3
    )
    assert results["design.stock_best.similarity_error"].value <= 0.1
    assert results["design.stock.examined"].value >= 1e6


def test_friction_makes_a_pretension_that_is_not_scaled_cost_more_than_statics_tell(bench: Bench) -> None:
    results = bench[1].results
    scaled, used = (
        results[f"similarity_with_friction.{name}.fig14.at_rest.rms"].value for name in ("scaled", "as_used")
    )
    assert scaled < 0.1
    assert used > 10 * scaled
    assert results["causes.as_used.with_friction.T_o/(kr).rms"].value > 0.9 * used


def test_missed_targets_are_named_with_what_bounds_them(bench: Bench) -> None:
    out, context, _ = bench
    html = (out / "report.html").read_text("utf-8")
    assert context.results["campaign.straightening.friction_error"].value > 10
    assert "Targets missed, and what bounds them" in html
    assert "nobody tells the controller of the bend" in html


def test_what_cannot_be_compensated_is_left_out_with_a_sentence(tmp_path: Path) -> None:
    run(tn.load("scaled-up").replace(pretension="0 N"), None, tmp_path, recordings=False, seeds=1)
    assert (tmp_path / "report.html").read_text("utf-8").count("scaled-up cannot be compensated") == 3


def test_the_table_of_results_in_the_docs_is_current(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    generate = import_module("generate")
    assert generate.results(bench[1]) == (ROOT / "docs/results.md").read_text("utf-8"), "run make docs"


def test_progress_reaches_its_announced_end(bench: Bench) -> None:
    _, context, told = bench
    assert len(told) == steps(context.inst, context.scaled)


def test_a_second_run_gives_the_same_results(bench: Bench, tmp_path: Path) -> None:
    out, _, _ = bench
    run(tn.load("real-size"), tn.load("scaled-up"), tmp_path, recordings=False, seeds=SEEDS)
    for name in ("results.json", "report.html", "curves/fig8_tension.csv", "figures/fig8_tension.svg"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes(), name


@pytest.mark.parametrize("name", ["pulley", "continuum"])
def test_other_mechanisms_get_a_report_without_the_papers_numbers(
    name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    inst: Instrument = request.getfixturevalue(name)
    context = run(inst, None, tmp_path, recordings=False, seeds=1)
    html = (tmp_path / "report.html").read_text("utf-8")
    assert inst.name in html
    assert "No scale model was given" in html
    assert "Published and computed" not in html
    assert all(result.published is None for result in context.results.values())


def test_a_changed_instrument_is_not_set_beside_the_papers_numbers(tmp_path: Path) -> None:
    real = tn.load("real-size")
    context = run(real.replace(tendon_diameter="0.5 mm"), tn.load("scaled-up"), tmp_path, recordings=False, seeds=0)
    assert not context.is_paper
    assert all(result.published is None for result in context.results.values())


def test_a_failed_run_leaves_the_old_report_whole(
    bench: Bench, pulley: Instrument, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copytree(bench[0], tmp_path, dirs_exist_ok=True)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def fail(*_: object) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(report, "render", fail)
    with pytest.raises(BenchError, match="cannot be written: No space left on device"):
        run(pulley, None, tmp_path, seeds=0)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert not list(tmp_path.glob(".bench-*"))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(BenchError, match="file/out cannot be written"):
        run(tn.load("scaled-up"), None, tmp_path / "file/out", seeds=0)


REAL = (ROOT / "instruments/real-size.toml").read_text("utf-8")
UNUSUAL = {
    "handle that ends before the working range": ('handle_range = "45 deg"', 'handle_range = "30 deg"'),
    "distal gear larger than the proximal one": ('distal_gear_radius = "2 mm"', 'distal_gear_radius = "6 mm"'),
    "working range of half a turn": ('output_range = "80 deg"', 'output_range = "170 deg"'),
    "working range of one degree": ('output_range = "80 deg"', 'output_range = "1 deg"'),
    "loads past every fold": ('"0.5 N", "1 N", "2 N", "3 N"', '"20 N", "500 N"'),
    "loads of next to nothing": ('"0.5 N", "1 N", "2 N", "3 N"', '"2 uN"'),
    "loads that are nearly the same": ('"0.5 N", "1 N", "2 N", "3 N"', '"1 N", "1.0000001 N"'),
    "twelve loads": ('"0.5 N", "1 N", "2 N", "3 N"', ", ".join(f'"{n / 10} N"' for n in range(1, 13))),
    "no loads": ('forces = ["0.5 N", "1 N", "2 N", "3 N"]', ""),
    "one held state": ("[conditions]", '[conditions]\noutput_angles = ["30 deg"]'),
    "held states next to each other": ("[conditions]", '[conditions]\noutput_angles = ["30 deg", "30.2 deg"]'),
    "held states out of reach": ("[conditions]", '[conditions]\noutput_angles = ["100 deg", "150 deg"]'),
    "no pretension": ('pretension = "30 N"', 'pretension = "0 N"'),
    "a name with markup": ('name = "real-size"', 'name = "<b>R&D</b> [/v2] $x_1$"'),
    "soft tendons": ('tendon_modulus = "50 GPa"', 'tendon_modulus = "500 MPa"'),
    "a second axis of its own": ("[conditions]", '[overrides.pitch]\ndistal_gear_radius = "2.2 mm"\n[conditions]'),
}


@pytest.fixture
def only_vectors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw what the report shows, and not again as PNG: of that, other tests tell."""
    monkeypatch.setattr(import_module("tenodesis.paper.run"), "_DRAWINGS", ("svg",))


@pytest.mark.usefixtures("only_vectors")
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("change", UNUSUAL.values(), ids=UNUSUAL.keys())
def test_unusual_instruments_get_a_report_too(change: tuple[str, str], tmp_path: Path) -> None:
    assert change[0] in REAL
    inst = tn.parse(REAL.replace(*change, 1))
    context = run(inst, inst, tmp_path, recordings=False, seeds=0)
    html = (tmp_path / "report.html").read_text("utf-8")
    text = re.sub(r"<svg.*?</svg>|<style.*?</style>", "", html, flags=re.S)
    assert ">nan" not in text
    assert "<b>R&D" not in text
    assert context.results["verification.scipy.instrument.disputed"].value == 0
    assert context.results["verification.mujoco.instrument.disputed"].value <= 1  # on the fold itself


@pytest.mark.usefixtures("only_vectors")
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("pulley", {"output_range": "170 deg"}),
        ("pulley", {"handle_range": "10 deg"}),
        ("continuum", {"backbone_rigidity": "2 N*m^2"}),
        ("continuum", {"backbone_rigidity": "20 N*mm^2"}),
    ],
)
def test_unusual_instruments_of_other_mechanisms_get_a_report_too(
    name: str, changes: dict[str, str], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    inst: Instrument = request.getfixturevalue(name).replace(**changes)
    assert "shrinks faster" not in report_text(inst, tmp_path)


def report_text(inst: Instrument, out: Path) -> str:
    run(inst, inst.replace(name="scaled"), out, seeds=0)
    return (out / "report.html").read_text("utf-8")


def test_what_others_keep_in_the_folder_stays(tmp_path: Path, pulley: Instrument) -> None:
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures/mine.tex").write_text("mine")
    run(pulley, None, tmp_path, recordings=False, seeds=0)
    assert (tmp_path / "figures/mine.tex").read_text() == "mine"
