"""Claims about ``tenodesis scale``: what it writes, what it says, and what it refuses in one sentence."""

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import tenodesis as tn
from tenodesis import cad
from tenodesis.cli import cad as cli_cad
from tenodesis.errors import Error, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.simulate.execution import check_controllable

from .conftest import Command

FILES = ["front.csv", "front.png", "front.svg", "parts.csv", "plan.html", "plan.pdf", "scaled-up.toml"]
PARTS = [
    "checklist.csv", "controller.h", "first-run-controlled.toml", "first-run.toml", "order.csv", "tolerances.csv",
    "tolerances.toml",
]  # fmt: skip
PAPER = [
    "--catalogue",
    "paper",
    *(f"--pin={key}={value}" for key, value in (
        ("distal_gear_radius", "7.5 mm"),
        ("proximal_gear_radius", "16.875 mm"),
        ("overall_length", "1 m"),
        ("end_effector_length", "86 mm"),
        ("handle_length", "160 mm"),
    )),
]  # fmt: skip


@pytest.mark.slow
def test_a_workshop_gets_an_instrument_file_a_plan_and_the_front(tenodesis: Command, tmp_path: Path) -> None:
    code, said, wrong = tenodesis("scale", "real-size", "--combinations", 5000)
    assert (code, wrong) == (0, "")
    folder = tmp_path / "prototype"
    assert sorted(path.name for path in folder.iterdir()) == sorted([*FILES, *PARTS])
    assert "scale models judged" in said
    assert re.search(r"95 % keep 0\.\d+° \(2000 drawn\)", said)
    assert "is taken: real-size-scaled-up, length x" in said
    inst = tn.load(folder / "scaled-up.toml")
    error = tn.similarity.compare(tn.load("real-size").axis("yaw"), inst).error(pretension=inst.pretension)
    rows = list(csv.DictReader((folder / "front.csv").open()))
    taken = rows[int(re.search(r"Row (\d+) is taken", said)[1]) - 1]  # type: ignore[index]
    assert float(taken["similarity error [deg]"]) == pytest.approx(error.largest, abs=0.02)
    assert float(taken["overall length [mm]"]) == pytest.approx(1e3 * inst.overall_length)
    assert (folder / "plan.pdf").read_bytes().startswith(b"%PDF")
    assert tenodesis("check", "prototype/scaled-up.toml")[0] == 0
    # The pack is consistent: its protocols fit its instrument file, and the controller can run that which is for it.
    for name in ("first-run", "first-run-controlled"):
        assert 300 < tn.simulate.load(folder / f"{name}.toml").duration(inst) < 600
    check_controllable(tn.simulate.load(folder / "first-run-controlled.toml").plan(inst, 1e-3), inst, inst)
    assert tn.tolerance.load(folder / "tolerances.toml").name == "as drawn"
    page = (folder / "plan.html").read_text("utf-8")
    assert "as designed: largest similarity error" in page and "as built: its median" in page
    again = ("scale", "real-size", "--combinations", 5000, "--no-parts", "--overwrite")
    code, said, _ = tenodesis(*again)
    assert (code, "warning: of an earlier design are order.csv" in said) == (0, True)


@pytest.mark.slow
def test_what_would_be_better_than_the_papers_prototype_is_told(tenodesis: Command, tmp_path: Path) -> None:
    code, said, _ = tenodesis(
        "scale", "real-size", *PAPER, "--combinations", 100_000, "--out", "paper", "--no-parts"
    )  # fmt: skip
    assert code == 0
    assert "1 scale models judged, 1 meet every constraint, 1 on the front" in said
    assert re.search(r"length x 3\.75, force x 2\.88, tension x 1\.378, time x \S+; pretension 41\.33 N\.", said)
    assert "scale models are as good or better in everything; the most similar one has similarity error" in said
    assert "Giving up 10 % of the others" in said
    inst = tn.load(tmp_path / "paper/scaled-up.toml")
    assert inst.tendon_stiffness == pytest.approx(11451, abs=0.5)


@pytest.mark.slow
def test_a_factor_pins_the_distal_radius(tenodesis: Command, tmp_path: Path) -> None:
    assert tenodesis("scale", "real-size", "--factor", 3.75, "--combinations", 5000, "--no-parts")[0] == 0
    inst = tn.load(tmp_path / "prototype/scaled-up.toml")
    assert isinstance(inst, tn.TendonGear)
    assert inst.distal_gear_radius == pytest.approx(7.5e-3)


@pytest.mark.slow
def test_a_plan_has_the_picture_of_its_solids_and_their_inertia(
    tenodesis: Command, declined: Callable[..., Error], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With solids made up, so that the kernel is not needed."""

    def build(inst: Instrument, **_: Any) -> Any:
        return SimpleNamespace(given=inst, process=cad.PROCESSES["sla"])

    def write(_model: Any, folder: Path, *_: Any) -> Any:
        folder.mkdir(exist_ok=True)
        (folder / "assembly.svg").write_text('<?xml version="1.0"?><svg width="9" height="9"><g id="parts"/></svg>')
        return SimpleNamespace()

    monkeypatch.setattr(cli_cad, "require", lambda *_: None)
    monkeypatch.setattr(cli_cad, "print_checks", lambda *_: None)
    monkeypatch.setattr(cad, "build", build)
    monkeypatch.setattr(cad, "write", write)
    monkeypatch.setattr(
        cad, "with_inertia", lambda model: model.given.replace(**{"dynamics.tip_inertia": "3e-5 kg*m^2"})
    )
    words = ("scale", "real-size", "--combinations", 5000, "--no-parts", "--cad", "solids")
    code, said, _ = tenodesis(*words)
    assert (code, "Its solids, drawings and pictures are written to solids." in said) == (0, True)
    assert tn.load(tmp_path / "prototype/scaled-up.toml").dynamics.tip_inertia == pytest.approx(3e-5)
    page = (tmp_path / "prototype/plan.html").read_text("utf-8")
    assert '<svg><g id="solids-parts"/></svg>' in page
    assert '<a href="../solids/assembly.glb">' in page

    def refuse(*_: Any, **__: Any) -> Any:
        raise InstrumentError(key="distal_gear_radius", value=2.0, allowed="larger")

    monkeypatch.setattr(cad, "build", refuse)
    # What cannot be made is told when the plan is written.
    assert declined(*words, "--overwrite").key == "distal_gear_radius"
    assert "assembly.glb" not in (tmp_path / "prototype/plan.html").read_text("utf-8")
    assert declined(*words[:-1], "prototype").key == "--cad"


@pytest.mark.slow
def test_a_row_of_the_front_can_be_taken(tenodesis: Command, tmp_path: Path) -> None:
    tenodesis("scale", "real-size", "--combinations", 5000, "--prefer", "size", "--no-parts")
    rows = list(csv.DictReader((tmp_path / "prototype/front.csv").open()))
    shortest = min(float(row["overall length [mm]"]) for row in rows)
    taken = tn.load(tmp_path / "prototype/scaled-up.toml")
    assert 1e3 * taken.overall_length == pytest.approx(shortest, rel=0.011)
    again = ("--pick", len(rows), "--overwrite", "--no-parts")
    code, _, _ = tenodesis("scale", "real-size", "--combinations", 5000, *again)
    taken = tn.load(tmp_path / "prototype/scaled-up.toml")
    assert code == 0
    assert 1e3 * taken.overall_length == pytest.approx(float(rows[-1]["overall length [mm]"]))


@pytest.mark.slow
def test_an_own_catalogue_is_merged_with_shipped_ones(tenodesis: Command, tmp_path: Path) -> None:
    own = (
        '[[ropes]]\nname = "cord"\ndiameter = "1 mm"\nmodulus = "40 GPa"\nbreaking_load = "900 N"\nsource = "tested"\n'
    )
    (tmp_path / "own.toml").write_text(own)
    code, said, wrong = tenodesis(
        "scale", "real-size", "--catalogue", "standard", "--catalogue", "own.toml", "--pin", "rope=cord",
        "--combinations", 5000, "--no-parts",
    )  # fmt: skip
    assert (code, wrong) == (0, "")
    assert tn.load(tmp_path / "prototype/scaled-up.toml").breaking_load == 900
    assert "Without the pins" in said


@pytest.mark.slow
def test_an_objective_takes_the_best_of_all_designs_by_it(tenodesis: Command, tmp_path: Path) -> None:
    code, said, wrong = tenodesis(
        "scale", "real-size", "--combinations", 5000, "--objective", "smallest", "--no-parts"
    )  # fmt: skip
    assert (code, wrong) == (0, "")
    assert "Another design is taken" in said
    inst = tn.load(tmp_path / "prototype/scaled-up.toml")
    smallest = re.search(r"smallest\s+\S+\s+(\d+) mm", said)
    assert smallest is not None
    assert 1e3 * inst.overall_length == pytest.approx(float(smallest[1]), rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["--catalogue", "nowhere.toml"], "file"),
        (["--pin", "overall_length"], "--pin"),
        (["--pin", "overall_length=1"], "overall_length"),
        (["--pin", "size=1 m"], "size"),
        (["--pin", "rope=a", "--pin", "rope=b"], "--pin"),
        (["--pick", "0"], "--pick"),
        (["--as-built", "0.3"], "--as-built"),
        (["--objective", "cheapest", "--pick", "1"], "--pick"),
        (["--combinations", "0"], "combinations"),
        (["--factor", "4", "--pin", "factor=3"], "--pin"),
        (["--factor", "1"], "distal_gear_radius"),
    ],
)
def test_a_mistake_is_refused_by_its_key(
    declined: Callable[..., Error], tmp_path: Path, arguments: list[str], key: str
) -> None:
    if "--combinations" not in arguments:
        arguments = [*arguments, "--combinations", "5000"]
    assert declined("scale", "real-size", *arguments).key == key
    assert not (tmp_path / "prototype").exists()


def test_schemas_of_every_kind_of_file_are_printed(tenodesis: Command) -> None:
    assert json.loads(tenodesis("schema")[1])["title"] == "Tenodesis instrument"
    assert json.loads(tenodesis("schema", "protocol")[1])["title"] == "Tenodesis protocol"
    assert json.loads(tenodesis("schema", "catalogue")[1])["title"] == "Tenodesis catalogue"
    assert "olerance" in json.loads(tenodesis("schema", "tolerances")[1])["title"]
    code, _, wrong = tenodesis("schema", "car")
    assert code == 2
    assert "'car' is not one of 'instrument', 'protocol', 'catalogue', 'tolerances'" in wrong
