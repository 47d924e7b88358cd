"""Claims about single sections of the report: that they work for any instrument, and that files are written or none."""

import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from peers import checks

import tenodesis as tn
from tenodesis.errors import ReportError
from tenodesis.instrument import Instrument
from tenodesis.paper import (
    campaign,
    compensated_cycles,
    compensated_step,
    compensation_laws,
    cycles,
    input_output,
    loss,
    report,
    scale_model_design,
    slack,
    step_load,
    tables_1_2_scale_model,
    transmissibility,
    unlike_model,
    workspace,
)
from tenodesis.paper.context import Context
from tenodesis.paper.run import CHAPTERS, chosen, run, steps, write
from tenodesis.report import style
from tenodesis.report.content import Section

from .conftest import ROOT, refused

STATICS = (input_output, slack, transmissibility, loss, compensation_laws)
COMPENSATED = (compensated_step, compensated_cycles)
SIMULATED = ("cycles", "step-load", "compensated-step-load", "compensated-cycles", "campaign")
REAL = (ROOT / "instruments/real-size.toml").read_text("utf-8")

Sections = Iterable[Callable[[Context], Section]]


def computed(context: Context, sections: Sections, *, drawn: bool = True) -> str:
    """Compute sections, lay out their figures without saving them, and return the text of the report on them."""
    with style.applied():
        done = [section(context) for section in sections]
        for plot in (plot for section in done for plot in section.plots):
            assert plot.curves
            if drawn:
                plot.figure.draw_without_rendering()
    drawings = {plot.name: "" for section in done for plot in section.plots}
    return re.sub(r"<style.*?</style>", "", report.render(context, done, drawings), flags=re.S)


def of(*modules: object) -> Sections:
    return [module.section for module in modules]  # type: ignore[attr-defined]


# A change of the real-size instrument's file, and the sections on which it bears besides the statics.
UNUSUAL: dict[str, tuple[tuple[str, str], tuple[object, ...]]] = {
    "handle that ends before the working range": (
        ('handle_range = "45 deg"', 'handle_range = "30 deg"'),
        (workspace, tables_1_2_scale_model, compensated_step),
    ),
    "distal gear larger than the proximal one": (
        ('distal_gear_radius = "2 mm"', 'distal_gear_radius = "6 mm"'),
        (tables_1_2_scale_model, step_load, compensated_cycles),
    ),
    "working range of half a turn": (
        ('output_range = "80 deg"', 'output_range = "170 deg"'),
        (workspace, cycles, compensated_step),
    ),
    "working range of one degree": (
        ('output_range = "80 deg"', 'output_range = "1 deg"'),
        (workspace, tables_1_2_scale_model, compensated_cycles),
    ),
    "loads past every fold": (
        ('"0.5 N", "1 N", "2 N", "3 N"', '"20 N", "500 N"'),
        (tables_1_2_scale_model, cycles, step_load, *COMPENSATED),
    ),
    "loads of next to nothing": (('"0.5 N", "1 N", "2 N", "3 N"', '"2 uN"'), (workspace, cycles, compensated_step)),
    "loads that are nearly the same": (
        ('"0.5 N", "1 N", "2 N", "3 N"', '"1 N", "1.0000001 N"'),
        (cycles, compensated_cycles),
    ),
    "more loads than colours": (
        ('"0.5 N", "1 N", "2 N", "3 N"', ", ".join(f'"{n / 10} N"' for n in range(1, 9))),
        (cycles,),
    ),
    "no loads": (('forces = ["0.5 N", "1 N", "2 N", "3 N"]', ""), (workspace, tables_1_2_scale_model, cycles)),
    "one held state": (("[conditions]", '[conditions]\noutput_angles = ["30 deg"]'), (step_load, compensated_step)),
    "held states next to each other": (
        ("[conditions]", '[conditions]\noutput_angles = ["30 deg", "30.2 deg"]'),
        (step_load, compensated_step),
    ),
    "held states out of reach": (
        ("[conditions]", '[conditions]\noutput_angles = ["100 deg", "150 deg"]'),
        (step_load, compensated_step),
    ),
    "no pretension": (
        ('pretension = "30 N"', 'pretension = "0 N"'),
        (tables_1_2_scale_model, cycles, step_load, *COMPENSATED),
    ),
    "a name with markup": (
        ('name = "real-size"', 'name = "<b>R&D</b> [/v2] $x_1$ {0}"'),
        (tables_1_2_scale_model, cycles, step_load),
    ),
    "soft tendons": (
        ('tendon_modulus = "50 GPa"', 'tendon_modulus = "500 MPa"'),
        (workspace, tables_1_2_scale_model, compensated_cycles),
    ),
    "a second axis of its own": (
        ("[conditions]", '[overrides.pitch]\ndistal_gear_radius = "2.2 mm"\n[conditions]'),
        (workspace, tables_1_2_scale_model, step_load),
    ),
}


def unusual(name: str) -> Instrument:
    (old, new), _ = UNUSUAL[name]
    assert old in REAL
    return tn.parse(REAL.replace(old, new, 1))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", UNUSUAL)
def test_the_statics_of_unusual_instruments_get_a_report(name: str) -> None:
    inst = unusual(name)
    text = computed(Context.of(inst, inst), of(*STATICS))
    assert ">nan" not in text
    assert "<b>R&D" not in text


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "module"),
    [
        pytest.param(name, module, id=f"{name}-{module.__name__.rpartition('.')[2]}")  # type: ignore[attr-defined]
        for name, (_, modules) in UNUSUAL.items()
        for module in modules
    ],
)
def test_a_section_on_which_an_unusual_value_bears_gets_a_report(name: str, module: object) -> None:
    inst = unusual(name)
    text = computed(Context.of(inst, inst), of(module))
    assert ">nan" not in text
    assert "<b>R&D" not in text


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["distal gear larger than the proximal one", "working range of half a turn", "no pretension"]
)
def test_scipy_and_mujoco_agree_with_the_statics_of_unusual_instruments(name: str) -> None:
    inst = unusual(name)
    context = Context.of(inst, inst)
    computed(context, of(checks))
    assert context.results["verification.scipy.instrument.disputed"].value == 0
    assert context.results["verification.mujoco.instrument.disputed"].value <= 1  # on the fold itself


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "changes", "module"),
    [
        ("pulley", {"output_range": "170 deg"}, tables_1_2_scale_model),
        ("pulley", {"handle_range": "10 deg"}, cycles),
        ("continuum", {"backbone_rigidity": "2 N*m^2"}, step_load),
        ("continuum", {"backbone_rigidity": "20 N*mm^2"}, tables_1_2_scale_model),
    ],
)
def test_unusual_instruments_of_other_mechanisms_get_a_report_too(
    name: str, changes: dict[str, str], module: object, request: pytest.FixtureRequest
) -> None:
    inst: Instrument = request.getfixturevalue(name).replace(**changes)
    context = Context.of(inst, inst.replace(name="scaled"))
    text = computed(context, of(*STATICS, module))
    assert "shrinks faster" not in text


@pytest.mark.slow
def test_a_continuum_gets_a_report_without_the_papers_numbers(continuum: Instrument) -> None:
    context = Context.of(continuum, seeds=1)
    rest = (workspace, tables_1_2_scale_model, scale_model_design, cycles, step_load, checks, *COMPENSATED, campaign)
    text = computed(context, of(*STATICS, *rest), drawn=False)
    assert continuum.name in text
    assert "No scale model was given" in text
    assert "Published and computed" not in text
    assert context.results["campaign.step_load.final_error_rms"].value < 5
    assert all(result.published is None for result in context.results.values())


PAPER_ONLY = r"\bmet\b|missed|[Pp]ublished|Fig\.|Table I|as printed|the paper's|Care point|needs care|of the paper\)"


@pytest.mark.parametrize("name", ["pulley", "continuum", "gear"])
def test_the_report_of_an_own_instrument_speaks_of_that_instrument(name: str, request: pytest.FixtureRequest) -> None:
    own = tn.load("real-size").replace(name="gear", end_effector_length="30 mm", **{"control.force_limit": "6 N"})
    inst: Instrument = own.axis("yaw") if name == "gear" else request.getfixturevalue(name)
    assert inst.sources == {} or name == "gear"
    context = Context.of(inst.replace(sources=None), seeds=0)
    text = computed(context, [one.section for key, one in chosen(context).items() if key not in SIMULATED], drawn=False)
    said = re.sub(r"<footer>.*?</footer>", "", text, flags=re.S)
    assert not re.findall(PAPER_ONLY, said)
    assert "−30 %" not in said or name == "gear"
    assert not any(key.startswith("care.") for key in context.results)
    assert ">source<" not in said
    assert "No scale model" not in said and "see the tests" not in said


@pytest.mark.slow
@pytest.mark.parametrize("law", ["none", "capstan"])
def test_an_own_instrument_is_compensated_without_the_papers_targets(law: str, pulley: Instrument) -> None:
    rough = {"friction.vertex_coefficient": 0.1, "friction.law": law} if law != "none" else {}
    context = Context.of(pulley.replace(**rough), seeds=1)
    text = computed(context, [CHAPTERS[name].section for name in SIMULATED], drawn=False)
    said = re.sub(r"<footer>.*?</footer>", "", text, flags=re.S)
    assert not re.findall(PAPER_ONLY, said)
    assert "the controller’s limit is 90 N" in said
    for of_friction in ("−30 %", "above theory", "friction scale", "sheath bent", "with friction</h2>"):
        assert (of_friction in said) == (law != "none" and of_friction != "sheath bent")


def test_the_papers_instruments_keep_its_figures_targets_and_care_points(real: Instrument, scaled: Instrument) -> None:
    for context in (Context.of(real, scaled), Context.of(scaled), Context.of(real)):
        assert not context.is_own
        text = computed(context, of(slack, transmissibility, compensation_laws), drawn=False)
        assert all(part in text for part in ("Fig. 8", "Fig. 9", "as printed", "Care point 1", "Care point 2"))


def test_chapters_are_computed_by_name(tmp_path: Path, pulley: Instrument) -> None:
    progress: list[str] = []
    context = run(pulley, None, tmp_path, progress.append, only=["slack", "loss"])
    assert progress == ["slack", "loss", "writing"]
    assert len(progress) == steps(pulley, None, ["slack", "loss"])
    assert {key.partition(".")[0] for key in context.results} == {"tension", "loss"}
    text = (tmp_path / "report.html").read_text("utf-8")
    assert re.findall(r'<h2 id="(\w+)"', text) == ["instruments", "tension", "loss"]
    assert not re.search('href="#(?!instruments|tension|loss)', re.sub(r"<svg.*?</svg>", "", text, flags=re.S))
    with refused("only", "los"):
        run(pulley, None, tmp_path, only=["los"])


@pytest.mark.process
def test_a_chapter_of_the_statics_loads_neither_the_twins_experiments_nor_scipy() -> None:
    code = (
        "import sys, tenodesis as tn; from pathlib import Path; from tenodesis.paper import run\n"
        "import tempfile\n"
        "with tempfile.TemporaryDirectory() as out: run(tn.load('scaled-up'), None, Path(out), only=['loss'])\n"
        "heavy = {'scipy.optimize', 'mujoco', 'mcap', 'tenodesis.scaling'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr


def test_a_changed_instrument_is_not_set_beside_the_papers_numbers() -> None:
    context = Context.of(tn.load("real-size").replace(tendon_diameter="0.5 mm"), tn.load("scaled-up"))
    assert not context.is_paper
    computed(context, of(compensation_laws, tables_1_2_scale_model, scale_model_design, cycles), drawn=False)
    assert all(result.published is None for result in context.results.values())
    assert Context.of(tn.load("real-size"), tn.load("scaled-up")).is_paper


def test_what_cannot_be_compensated_is_left_out_with_a_sentence() -> None:
    context = Context.of(tn.load("scaled-up").replace(pretension="0 N"), seeds=1)
    text = computed(context, of(*COMPENSATED, campaign))
    assert text.count("scaled-up cannot be compensated") == 3
    assert not context.results


def test_without_mujoco_its_checks_are_left_out_with_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    inst = tn.load("real-size")
    context = Context.of(inst)
    text = computed(context, of(checks), drawn=False)
    assert text.count("left out: mujoco is not installed") == 1
    assert not [key for key in context.results if "mujoco" in key or key.startswith(("axes.", "care."))]
    assert context.results["verification.scipy.instrument.disputed"].value == 0


def test_curves_are_the_statics_at_their_columns(real: Instrument) -> None:
    (plot,) = input_output.section(Context.of(real)).plots
    handle = np.radians(plot.curves["handle_angle [deg]"])
    for force in (0, 1, 3):
        output = np.asarray(plot.curves[f"output_angle at {force} N [deg]"])
        drawn = np.isfinite(output)
        expected = np.degrees(tn.statics.output_angle(real, handle, force))
        assert drawn.any()
        assert np.allclose(output[drawn], expected[drawn], atol=1e-9)


def test_the_campaign_gives_the_same_results_again_over_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compensated_step, "FRICTION_ERRORS", (0.3,))
    condition = campaign.conditions(Context.of(tn.load("scaled-up")))[0]
    first, second = (campaign.trials(condition, 1) for _ in range(2))
    assert list(first) == list(second)


def test_the_same_sections_are_written_as_the_same_files(tmp_path: Path, pulley: Instrument) -> None:
    for out in (tmp_path / "first", tmp_path / "second"):
        context = Context.of(pulley)
        with style.applied():
            write(context, [transmissibility.section(context)], out)
    files = [path.relative_to(out) for path in out.rglob("*") if path.suffix in (".svg", ".csv", ".html", ".json")]
    assert len(files) == 4
    for file in files:
        assert (tmp_path / "first" / file).read_bytes() == (tmp_path / "second" / file).read_bytes(), file


def test_a_failed_run_leaves_the_old_report_complete_and_the_files_of_others_alone(
    tmp_path: Path, pulley: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = Context.of(pulley)
    with style.applied():
        sections = [transmissibility.section(context)]
        (tmp_path / "figures").mkdir()
        (tmp_path / "figures/mine.tex").write_text("mine")
        write(context, sections, tmp_path)
        assert (tmp_path / "report.html").exists()
        before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
        assert before[tmp_path / "figures/mine.tex"] == b"mine"

        def fail(*_: object) -> str:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(report, "render", fail)
        with refused("path", kind=ReportError):
            write(context, sections, tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert {path.name for path in tmp_path.iterdir()} == {"curves", "figures", "report.html", "results.json"}


def test_a_folder_that_cannot_be_made_is_named_before_anything_is_computed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    progress: list[str] = []
    with pytest.raises(ReportError, match="file/out cannot be written"):
        run(tn.load("scaled-up"), None, tmp_path / "file/out", progress.append)
    assert not progress


def test_every_section_of_the_package_is_in_the_report() -> None:
    chapters = [one for chapter in CHAPTERS.values() for one in (chapter, chapter.otherwise) if one is not None]
    modules = [one.module for one in chapters if not one.module.startswith("peers.")]
    folder = ROOT / "src/tenodesis/paper"
    assert sorted(modules) == sorted(
        path.stem for path in folder.glob("*.py") if re.search(r"^def section\(", path.read_text("utf-8"), re.M)
    )


def test_all_differences_at_once_are_those_of_every_other_row(scaled: Instrument) -> None:
    *single, every = unlike_model.differences(scaled)
    assert every.key == "all"
    assert every.homes
    assert every.unknown == {key: value for one in single for key, value in one.unknown.items()}
    assert every.known == {key: value for one in single for key, value in one.known.items()}
