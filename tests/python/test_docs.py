"""Claims about the documentation: what is generated is current, and what is shown runs."""

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel

from tenodesis.instrument import JOINT_TYPES, FullForm
from tenodesis.scaling.catalogue import CatalogueFile
from tenodesis.simulate import Protocol
from tenodesis.tolerance import Tolerances

from .conftest import ROOT

FILES = (*JOINT_TYPES.values(), FullForm, Protocol, CatalogueFile, Tolerances)

DRAWN = ("docs/picture.svg", "docs/dimensions.svg", "docs/conventions.svg", "docs/routing.svg", "docs/posture.svg")


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Any]:
    """Import what writes into pages."""
    monkeypatch.syspath_prepend(ROOT / "docs/site_extension")
    monkeypatch.syspath_prepend(ROOT / "studies")
    return import_module


@pytest.mark.slow
@pytest.mark.process
def test_pictures_are_current(tmp_path: Path) -> None:
    code = f"import sys; sys.path.insert(0, {str(ROOT / 'docs')!r}); import generate, pathlib; "
    code += f"generate.main(pathlib.Path({str(tmp_path)!r}))"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300)
    for name in DRAWN:
        assert (tmp_path / name).read_text("utf-8") == (ROOT / name).read_text("utf-8"), f"{name}: run make docs"


def test_every_equation_and_care_point_is_implemented_and_tested(site: Callable[[str], Any]) -> None:
    table = site("traceability").tables()
    rows = re.findall(r"^\| (\d+) \| (.*) \| (.*) \|$", table, re.M)
    assert [int(number) for number, _, _ in rows] == list(range(1, 23))
    assert [number for number, functions, tests in rows if "–" in (functions, tests)] == []
    care = re.findall(r"^\| \[(\d+)\]", table, re.M)
    assert [int(number) for number in care] == list(range(1, 10))


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        "docs/python.md",
        "docs/joints_and_tendons.md",
        "docs/twin.md",
        "docs/experiments.md",
        "docs/scaling.md",
    ],
)
def test_the_python_examples_run_and_print_what_they_say(page: str, tmp_path: Path) -> None:
    code = "".join(re.findall(r"```python\n(.*?)```", (ROOT / page).read_text("utf-8"), re.S))
    assert code
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120, cwd=tmp_path
    )
    said = [line.split("# ")[1].strip() for line in code.splitlines() if line.startswith("print")]
    assert done.stdout.splitlines() == said


def test_contributing_names_files_that_exist() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    named = [name for name in re.findall(r"`([\w./]+\.(?:hpp|h|py|md|cpp|toml))`", text) if name != "instrument.toml"]
    tracked = [
        str(path)
        for folder in ("include", "src", "docs", "tests", "benchmarks", "studies")
        for path in (ROOT / folder).rglob("*.*")
    ]
    assert len(named) > 50
    assert [name for name in named if not any(path.endswith(f"/{name}") for path in tracked)] == []


def test_the_map_of_contributing_names_every_header_and_every_package() -> None:
    """Where a file or package is new, the map has to say what its idea is."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8").split("## The map")[1].split("\n## ")[0]
    cells = {
        title: set(re.findall(r"`([\w.]+)/?`", " ".join(re.findall(r"^\| (`[^|]*) \|", rows, re.M))))
        for title, rows in re.findall(r"^\| (?:file in `)?([\w/]+)`? \|.*\n\|-.*\n((?:\|.*\n)+)", text, re.M)
    }
    headers = {
        folder: {path.name for path in (ROOT / folder).iterdir() if path.suffix in (".hpp", ".h")}
        for folder in ("include/tenodesis/", "src/engine/", "src/runtime/")
    }
    package = ROOT / "src/tenodesis"
    parts = {path.stem for path in package.iterdir() if path.suffix == ".py" or any(path.glob("*.*"))}
    assert cells == headers | {"package": parts - {"__init__", "__pycache__"}}


def test_every_guarantee_names_tests_that_exist() -> None:
    rows = re.findall(r"^\| (?!guarantee)(\w.*) \|$", (ROOT / "docs/guarantees.md").read_text("utf-8"), re.M)
    assert len(rows) > 25
    for row in rows:
        *_, tests = row.split(" | ")
        named = re.findall(r"`(\w+)(\.cpp)?::(\w+)`", tests)
        assert named or (tests == "–" and re.search(r"benchmarks/|make firmware", row)), row
        for file, ending, function in named:
            path = ROOT / ("tests/cpp" if ending else "tests/python") / f"{file}{ending or '.py'}"
            kind = r"\b" if ending else "^def "
            assert re.search(rf"{kind}{function}\(", path.read_text("utf-8"), re.M), f"{file}::{function}"


def test_links_between_the_documents_lead_somewhere() -> None:
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text("utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_every_key_of_every_file_is_in_the_tables_of_the_page(site: Callable[[str], Any]) -> None:
    kinds = re.findall(r"\{\{keys (\w+)\}\}", (ROOT / "docs/keys.md").read_text("utf-8"))
    tables = "\n".join(map(site("keys").tables, kinds))
    rows = re.findall(r"^\| `(\w+)` \| .+ \| .+ \| .* \| (.+) \|$", tables, re.M)
    fields = [field for kind in FILES for model in models_below(kind) for field in model.model_fields.items()]
    keys = {field.alias or name for name, field in fields} - {"kind"}
    assert len(keys) > 150
    assert keys <= {key for key, _ in rows}
    assert {field.description for _, field in fields if field.description} <= {meaning for _, meaning in rows}


def test_every_figure_that_a_page_quotes_is_in_the_file(site: Callable[[str], Any]) -> None:
    generated, quoted = site("generated"), 0
    for page in (ROOT / "docs").rglob("*.md"):
        for kind, words in generated.PLACE.findall(page.read_text("utf-8")):
            if kind in ("table", "figure"):
                assert generated.WRITERS[kind](words), f"{page.name}: {words}"
                quoted += 1
    assert quoted > 20


def test_a_table_that_is_kept_is_read_as_it_was(site: Callable[[str], Any], tmp_path: Path) -> None:
    figures, file = site("figures"), tmp_path / "results.json"
    headings = figures.Heading("final_rms", "final RMS", "deg", ".2f"), figures.Heading("faults", "faults")
    table = figures.FigureTable("python studies/own.py", "what differs", [*headings], {"0.25 known": [0.1 + 0.2, ""]})
    figures.keep("own", figures.FigureTable("before", "", [], {}), file)
    figures.keep("other", table, file)
    figures.keep("own", table._replace(rows={"none": [np.nan, "slack"], "é": [np.float64(1), "–"]}), file)
    kept = figures.read(file)
    assert kept["other"] == table
    values = {name: value for name, (value, _) in figures.flat(kept).items()}
    assert values["other.0.25_known.final_rms"] == 0.1 + 0.2
    assert (values["own.none.final_rms"], values["own.none.faults"], values["own.é.final_rms"]) == (None, "slack", 1.0)


def models_below(kind: Any) -> Iterator[type[BaseModel]]:
    """Yield a model and those of the tables in it."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
        for field in kind.model_fields.values():
            yield from models_below(field.annotation)
    for option in get_args(kind):
        yield from models_below(option)
