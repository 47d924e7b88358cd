"""Claims about the workshop plan: HTML and PDF of the same content, whatever the names and however long the lists."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import tenodesis as tn
from tenodesis import scaling
from tenodesis.errors import DesignError
from tenodesis.scaling import catalogue, plan
from tenodesis.scaling.candidates import Wheel
from tenodesis.scaling.catalogue import Constraints
from tenodesis.scaling.parts import Weight
from tenodesis.scaling.plan import PlanFigure, PlanTable, ScalePlan
from tenodesis.scaling.scale_model import Choice, Design, Objectives
from tenodesis.scaling.weights import select_weights

from .conftest import ROOT


def table(found: ScalePlan, caption: str) -> PlanTable:
    """Return the table of a plan whose caption begins so."""
    blocks = (one for row in found.rows for one in row)
    return next(one for one in blocks if isinstance(one, PlanTable) and one.caption.startswith(caption))


PAPER = catalogue.load("paper").model_copy(
    update={"constraints": Constraints(tension_margin=3.0, load_cell_margin=1.2, force_tolerance=0.02)}
)


def made(
    *,
    real_size: Any = None,
    scaled_up: Any = None,
    forces: tuple[float, ...] = (0.5, 1.0, 2.0, 3.0),
    parts: Any = PAPER,
    choice: dict[str, Any] | None = None,
    margin: float = 3.4,
    largest_force: float | None = None,
) -> Design:
    """Return a design, by default the paper's pair with the pretension that is similar."""
    real_size = real_size or tn.load("real-size").axis("yaw")
    scaled_up = scaled_up or tn.load("scaled-up").replace(pretension=41.3)
    comparison = tn.similarity.compare(real_size, scaled_up, largest_force=largest_force)
    factor, lever = float(comparison.force_factor()), parts.constraints.cable_pulley_radius / scaled_up.rig_arm
    tests = []
    for force in forces:
        weights = select_weights(force * factor / lever, parts.weights, cable_mass=parts.constraints.cable_mass)
        off = weights.error * lever / factor
        tests.append(scaling.TestLoad(force, force * factor + off, weights, off, "-fx"))
    taken: dict[str, Any] = {
        "distal": Wheel(7.5e-3, 1.25e-3, 12),
        "proximal": Wheel(16.875e-3, 1.25e-3, 27),
        "rope": parts.ropes[0],
        "rod": None,
        "load_cell": parts.load_cells[0],
        "encoder": parts.encoders[0],
        "spool": parts.spools[0],
    } | (choice or {})
    return Design(
        real_size=real_size,
        scaled_up=scaled_up,
        choice=Choice(**taken),
        catalogue=parts,
        objectives=Objectives(
            similarity_error=comparison.error(pretension=scaled_up.pretension).largest_snapped,
            force_resolution=0.018,
            overall_length=scaled_up.overall_length,
            tension_margin=margin,
        ),
        comparison=comparison,
        tests=tuple(tests),
        force_resolution=0.011,
        largest_tension=taken["rope"].breaking_load / margin,
    )


@pytest.fixture(scope="module")
def design() -> Any:
    return made()


@pytest.fixture(scope="module")
def found(design: Any) -> ScalePlan:
    return plan.content(design)


@pytest.fixture(scope="module")
def written(design: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return plan.write(design, tmp_path_factory.mktemp("prototype"))


HOSTILE = """<b>#1 $x$ _y_ *z* `q` "r" 's' & \\u{41} @t {{ u }} [v] //"""
LONG = "W" * 60


def pages(pdf: bytes) -> int:
    """Return how many pages a PDF says it has."""
    counts = re.findall(rb"/Type\s*/Pages\b[^>]*?/Count\s+(\d+)", pdf)
    assert len(counts) == 1
    return int(counts[0])


def texts(value: Any) -> Iterator[tuple[tuple[Any, ...], str]]:
    """Yield every text of a plan that is to be read, and the way to it."""
    if isinstance(value, str):
        yield (), value
    elif is_dataclass(value):
        for field in fields(value):
            if field.name != "svg":
                yield from (((field.name, *way), text) for way, text in texts(getattr(value, field.name)))
    elif isinstance(value, tuple):
        for index, one in enumerate(value):
            yield from (((index, *way), text) for way, text in texts(one))


def changed(value: Any, way: tuple[Any, ...], text: str) -> Any:
    """Return a plan with another text at one place."""
    if not way:
        return text
    if isinstance(value, tuple):
        return (*value[: way[0]], changed(value[way[0]], way[1:], text), *value[way[0] + 1 :])
    return replace(value, **{way[0]: changed(getattr(value, way[0]), way[1:], text)})


class Page(HTMLParser):
    """What an HTML file shows, and what it refers to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.shown: list[str] = []
        self.elements: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        if tag in ("td", "th", "p", "h1", "figcaption", "caption", "b"):
            self.shown.append("\n")

    def handle_data(self, data: str) -> None:
        self.shown.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.shown).split())


def test_plan_is_a_pdf_of_a4_and_a_file_for_the_screen(written: tuple[Path, Path]) -> None:
    page, pdf = written
    assert [path.name for path in written] == ["plan.html", "plan.pdf"]
    assert sorted(path.name for path in page.parent.iterdir()) == ["plan.html", "plan.pdf"]
    assert pages(pdf.read_bytes()) == 2
    assert b"/MediaBox[0 0 595.2756 841.8898]" in pdf.read_bytes()


def test_html_refers_to_nothing_outside(written: tuple[Path, Path]) -> None:
    text = written[0].read_text("utf-8")
    drawings = re.findall(r"<svg.*?</svg>", text, re.DOTALL)
    assert len(drawings) == 3
    for drawing in drawings:
        ElementTree.fromstring(drawing)
        # Within a drawing, only namespaces and the drawing itself.
        assert all(target.startswith(("#", "data:")) for target in re.findall(r'href="([^"]+)"', drawing))
        assert not re.findall(r"@import|url\((?!#)", drawing)
        text = text.replace(drawing, "")
    assert not re.search(r"https?:|//|@import|url\(|<script|<link", text)
    ids = re.findall(r'\bid="([^"]+)"', "".join(drawings))
    assert len(ids) == len(set(ids))


@pytest.mark.slow
def test_every_text_of_the_plan_stands_in_both(found: ScalePlan) -> None:
    blank = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="5"/>'
    whole = replace(
        found,
        rows=tuple(
            tuple(replace(one, svg=blank) if isinstance(one, PlanFigure) else one for one in row) for row in found.rows
        ),
    )
    shown = re.sub("[_ ]", "", Page(plan.html(whole)).text)
    pdf = plan.pdf(whole)
    seen = [(way, text) for way, text in texts(whole) if text]
    assert len(seen) > 150
    assert not [way for way, text in seen if re.sub("[_ \u00a0]", "", text) not in shown]
    # A text that does not show would change nothing; the last of every part stands for the part, and every field of
    # one table, since all tables are set alike.
    parts = {way[:2] if way[0] == "similarity" else way[:1]: way for way, _ in seen}
    for way in parts.values():
        assert plan.pdf(changed(whole, way, "Q")) != pdf, way


def test_numbers_are_those_of_the_design(design: Any, found: ScalePlan) -> None:
    text = " ".join(text for _, text in texts(found)).replace("\u00a0", " ")
    for number in (
        "41.3 N", "30 N real-size", "module 1.25 mm, 12 teeth", "module 1.25 mm, 27 teeth", "pitch radius 16.875 mm",
        "breaks at 177.6 N", "2 kg + 20 g + 10 g", "yaw: to where forces act 86",
        "0.088°", "0.15 N", "2.88", "1.378", "101",
    ):  # fmt: skip
        assert number in text, number
    assert [row[3:6] for row in table(found, "Test loads").rows][1] == ("1", f"{design.tests[1].force:.3f}", "19.39")


def test_cause_of_the_error_is_named_where_it_is_largest(found: ScalePlan, pinned: ScalePlan) -> None:
    assert "caused by l_d/r" in table(found, "Similarity error").note
    assert "caused by T_o/(kr)" in table(pinned, "Similarity error").note


def test_groups_are_said_to_match_or_not(found: ScalePlan) -> None:
    groups = table(found, "Groups")
    assert "R/r" in groups.note
    assert {"l_d/r", "l_p/R", "F/(kr)"} <= {row[0] for row in groups.rows}
    assert not any(row[-1] == "1" for row in groups.rows)
    matching, imposed, *_ = groups.note.split("; ")
    assert imposed == "made equal by the factors of force and time: Θ, J/(κ t²)"
    assert "Θ" not in matching and "κ" not in matching


def test_what_hangs_is_off_by_so_much_give_or_take_the_tolerance_of_the_weights(design: Any, found: ScalePlan) -> None:
    factor = tn.statics.loss_of_dexterity(design.real_size, design.real_size.output_range / 2, 1.0)
    factor /= tn.statics.loss_of_dexterity(design.scaled_up, design.real_size.output_range / 2, 1.0)
    for row, test in zip(table(found, "Test loads").rows, design.tests, strict=True):
        error, tolerance = row[7].replace("\u2212", "-").replace("\u00a0", "").split("±")
        assert float(error) == pytest.approx(test.error, abs=6e-5)
        tip = test.weights.tolerance * 0.015 / design.scaled_up.rig_arm
        assert float(tolerance) == pytest.approx(tip / factor, rel=0.5)
        assert float(tolerance) > 0


def test_the_plan_gives_the_motor_torque_at_the_largest_tension(design: Any, found: ScalePlan) -> None:
    (row,) = (row for row in table(found, "Parts").rows if row[1] == "spools")
    torque = design.largest_tension * design.choice.spool.radius
    assert row[3].replace("\u00a0", " ") == f"one motor each, {torque:.3g} N·m at the largest tension"


def test_a_margin_that_falls_short_is_written_so() -> None:
    assert plan.falling_short(2.99996, 3.0) == "2.99996"
    assert plan.falling_short(2.1, 3.0) == "2.10"


def test_card_and_table_give_the_same_error_where_a_tip_snaps_through(pinned: ScalePlan, similar: ScalePlan) -> None:
    rows = {name: largest for name, largest, _ in table(pinned, "Similarity error").rows}
    assert pinned.cards[-1].label.endswith(", a snapped tip at its stop")
    assert rows["without friction, a snapped tip at its stop"] == pinned.cards[-1].value
    assert rows["without friction, where both hold"] != pinned.cards[-1].value
    assert [row[0] for row in table(similar, "Similarity error").rows] == ["without friction", "with friction, at rest"]
    assert similar.cards[-1].value == table(similar, "Similarity error").rows[0][1]


def test_what_a_workshop_must_not_overlook_is_a_warning() -> None:
    coarse = PAPER.model_copy(update={"weights": (Weight(mass=0.05, count=9), Weight(mass=0.5, count=20))})
    weak = PAPER.load_cells[0].model_copy(update={"range": 90.0})
    bad = made(
        scaled_up=tn.load("scaled-up"), parts=coarse, margin=2.1, choice={"encoder": None, "load_cell": weak},
        forces=(0.03, 0.5),
    )  # fmt: skip
    said = "\n".join(plan.content(bad).warnings).replace("\u00a0", " ")
    for message in (
        r"Pretension is 25 N, 40 % below the similar 41\.3 N",
        r"The weights for 0\.03 N real-size are off by [+−]\d+\.\d+ %, more than 2 %",
        r"The rope breaks at 2\.10 × the largest tension; 3 × is required",
        r"The range of the load cells ends at 1\.06 × the largest tension; 1\.2 × is required",
        r"The controller winds no tendon above 80 N, below the plan's largest tension of 84\.6 N",
        r"No encoder of the catalogue fits a distal radius of 7\.5 mm",
        r"neither holds the load",
    ):
        assert re.search(message, said), message


@pytest.fixture(scope="module")
def pinned() -> ScalePlan:
    """The plan of the paper's pair, with the pretension that was used."""
    return plan.content(made(scaled_up=tn.load("scaled-up")))


@pytest.fixture(scope="module")
def similar() -> ScalePlan:
    """The plan of an exactly similar pair at small loads."""
    inst = tn.load("real-size").axis("yaw")
    scale = {"overall_length": 1.0, "distal_gear_radius": 4e-3, "proximal_gear_radius": 9e-3}
    same = inst.replace(**scale, end_effector_length=0.1, handle_length=0.24)
    similar = same.replace(pretension=tn.similarity.compare(inst, same).scaled_pretension)
    return plan.content(made(scaled_up=similar, largest_force=0.5, forces=(0.25, 0.5)))


def test_a_similar_design_without_flaw_has_no_warning(similar: ScalePlan) -> None:
    assert similar.warnings == ()
    assert similar.cards[-1].value == "below 0.001°"
    assert "too small to have a cause" in table(similar, "Similarity error").note


@pytest.mark.slow
def test_any_name_is_shown_as_it_is(tmp_path: Path) -> None:
    name = HOSTILE
    real_size = tn.load("real-size").axis("yaw").replace(name=name[:60])
    scaled_up = tn.load("scaled-up").replace(name=name[:60])
    rope = PAPER.ropes[0].model_copy(update={"name": name[:60]})
    design = made(
        real_size=real_size,
        scaled_up=scaled_up,
        parts=PAPER.model_copy(update={"name": name}),
        choice={"rope": rope, "load_cell": PAPER.load_cells[0].model_copy(update={"name": name[:60]})},
    )
    page, pdf = plan.write(design, tmp_path)
    shown = Page(page.read_text("utf-8"))
    assert shown.text.count(" ".join(name[:60].split())) >= 5
    assert shown.elements.count("b") == 6  # the cards' own
    if shutil.which("pdftotext"):
        read = subprocess.run(["pdftotext", "-layout", pdf, "-"], capture_output=True, text=True, check=True).stdout
        assert name[:60].split(maxsplit=1)[0][:20] in read.replace("\u200b", "")


@pytest.fixture(scope="module")
def crowded() -> Any:
    """Return a design with as much to say as there can be: twelve loads of many odd pieces, long names, all flaws."""
    box = (*(Weight(mass=3**n * 1e-5, count=1) for n in range(12)), Weight(mass=7.77, count=1))
    parts = PAPER.model_copy(update={"name": " + ".join(["catalogue of the workshop"] * 12), "weights": box})
    named = {"name": LONG}
    choice = {
        "rope": PAPER.ropes[0].model_copy(update=named),
        "load_cell": PAPER.load_cells[0].model_copy(update=named | {"range": 60.0}),
        "encoder": PAPER.encoders[0].model_copy(update=named),
    }
    return made(
        real_size=tn.load("real-size").axis("yaw").replace(name=LONG),
        scaled_up=tn.load("scaled-up").replace(name="M" * 60, tendon_length=1.1),
        forces=tuple(0.0713 * n for n in range(1, 13)),
        parts=parts,
        choice=choice,
        margin=2.0,
    )


@pytest.mark.slow
def test_long_lists_and_names_are_complete_and_stay_on_the_pages(crowded: Any, tmp_path: Path) -> None:
    page, pdf = plan.write(crowded, tmp_path)
    text = Page(page.read_text("utf-8")).text
    assert all(f"{test.real_force:.3g}" in text for test in crowded.tests)
    assert text.count(LONG) >= 4  # of a name that has no place to break it
    if shutil.which("pdftotext"):
        # What runs out of the page is cut off by the crop.
        command = ["pdftotext", "-x", "0", "-y", "0", "-W", "595", "-H", "842", pdf, "-"]
        read = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert read.replace("\u200b", "").replace("\n", "").count(LONG) >= 4


def test_many_weights_are_listed_to_a_dozen_kinds_and_the_lightest_summed_up() -> None:
    listed = plan.masses([1e-3 * n for n in range(1, 16)]).replace("\u00a0", " ")
    assert listed.startswith("15 g + 14 g + ")
    assert listed.endswith(" + 4 g + 3 smaller, not listed, of 6 g in all")


@pytest.mark.parametrize("file", ["pulley", pytest.param("continuum", marks=pytest.mark.slow)])
def test_other_mechanisms_have_a_plan(file: str, tmp_path: Path) -> None:
    real_size = tn.load(ROOT / f"examples/{file}.toml")
    real_size = real_size.axis(real_size.axes[0])
    radii = {
        key: 3 * getattr(real_size, key) for key, name in real_size.parameter_fields.items() if name.endswith("_radius")
    }
    scaled_up = real_size.replace(name="large", **radii)
    distal, proximal = (Wheel(radii[key]) for key in sorted(radii))
    rod = catalogue.load("rods").rods[0] if file == "continuum" else None
    design = made(
        real_size=real_size,
        scaled_up=scaled_up,
        forces=(0.1,),
        choice={"distal": distal, "proximal": proximal, "rod": rod},
    )
    found = plan.content(design)
    parts = [row[1] for row in table(found, "Parts").rows]
    assert "pulley, proximal joint" in parts
    assert ("set of discs, distal joint" if rod else "pulley, distal joint") in parts
    assert ("rod for a backbone" in parts) == bool(rod)
    assert [path.exists() for path in plan.write(design, tmp_path)] == [True, True]


def test_a_design_that_was_searched_for_has_a_plan(tmp_path: Path) -> None:
    front = scaling.design(tn.load("real-size"), catalogue.load("paper"), combinations=2000)
    found = front[front.best()]
    page, _ = plan.write(found, tmp_path)
    text = Page(page.read_text("utf-8")).text
    assert f"{found.choice.distal.teeth} teeth" in text
    assert f"{found.scaled_up.pretension:.3g} N".replace(" ", "") in text.replace(" ", "")


@pytest.mark.slow
def test_a_design_without_test_loads_has_a_plan(tmp_path: Path) -> None:
    assert plan.write(made(forces=()), tmp_path)[1].exists()


def test_nothing_is_written_where_the_folder_cannot_be(
    design: Any, found: ScalePlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plan, "content", lambda *_: found)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DesignError, match="file cannot be written"):
        plan.write(design, tmp_path / "file")
    (tmp_path / "plan.pdf").mkdir()
    with pytest.raises(DesignError, match="cannot be written"):
        plan.write(design, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "plan.pdf"]


def test_the_same_design_gives_the_same_bytes(design: Any, written: tuple[Path, Path], tmp_path: Path) -> None:
    again = plan.write(design, tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in written]


@pytest.mark.process
@pytest.mark.skipif(not shutil.which("chromium"), reason="there is no browser to print with")
def test_html_prints_on_two_pages(written: tuple[Path, Path], tmp_path: Path) -> None:
    page, _ = written
    command = [
        "chromium", "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
        "--disable-component-update", "--disable-sync", f"--user-data-dir={tmp_path / 'profile'}",
        "--no-pdf-header-footer", f"--print-to-pdf={tmp_path / 'printed.pdf'}", page.as_uri(),
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    assert len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "printed.pdf").read_bytes())) == 2
