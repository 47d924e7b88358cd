"""Claims about the commands for an instrument of one's own: `new` writes a file that holds, `loss` answers at once."""

import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.cli import common
from tenodesis.control.plausibility import implausible
from tenodesis.instrument import JOINT_TYPES, Instrument
from tenodesis.instrument.template import ASSUMED, QUESTIONS, ROPES, sketch

Run: TypeAlias = Callable[..., tuple[int, str, str]]

GIVEN = {
    "distal-radius": "2.5 mm",
    "proximal-radius": "5 mm",
    "backbone-length": "18 mm",
    "backbone-rigidity": "150 N*mm^2",
    "end-effector-length": "3 cm",
    "overall-length": "400 mm",
    "tendon-diameter": "0.5 mm",
    "pretension": "20 N",
}


def options(joint_type: str, **changed: str) -> list[str]:
    """Return the answers to all questions of a mechanism as options."""
    asked = [one.option for one in QUESTIONS[joint_type]]
    values = {key: value for key, value in GIVEN.items() if key in asked} | changed
    return ["--mechanism", joint_type, *(word for key, value in values.items() for word in (f"--{key}", value))]


def si(inst: Instrument) -> dict[str, float]:
    return {key: value for key, value, _ in inst.quantities()}


def answering(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


# ---------------------------------------------------------------------- new


@pytest.mark.parametrize("joint_type", JOINT_TYPES)
def test_a_new_file_is_the_instrument_that_was_described(tenodesis: Run, joint_type: str) -> None:
    code, said, wrong = tenodesis("new", "mine", *options(joint_type))
    assert (code, wrong) == (0, "")
    assert "mine.toml" in said
    inst = tn.load("mine.toml")
    assert (inst.name, inst.joint_type) == ("mine", joint_type)
    for one in QUESTIONS[joint_type]:
        assert si(inst)[one.key] == pytest.approx(si(inst.replace(**{one.key: GIVEN[one.option]}))[one.key], rel=1e-12)
        assert inst.sources[one.key] == "yours"
    again = tn.parse(tn.instrument.text.to_toml(inst))
    assert again == inst
    assert implausible(inst) == ()
    assert tenodesis("check", "mine.toml")[0] == 0


@pytest.mark.parametrize("joint_type", JOINT_TYPES)
def test_the_defaults_are_an_instrument_without_warnings_that_can_be_run(tenodesis: Run, joint_type: str) -> None:
    assert tenodesis("new", "mine", "--mechanism", joint_type, "--defaults")[0] == 0
    inst = tn.load("mine.toml")
    assert implausible(inst) == ()
    assert tn.statics.output_angle(inst, tn.statics.reach(inst)) == pytest.approx(inst.output_range, abs=1e-9)
    tn.twin.Twin(inst, seed=1).run(np.linspace(0, 0.1, 100))


@pytest.mark.parametrize("joint_type", JOINT_TYPES)
def test_every_key_of_a_new_file_has_a_comment_and_a_source(tenodesis: Run, tmp_path: Path, joint_type: str) -> None:
    tenodesis("new", "mine", "--mechanism", joint_type, "--defaults")
    text = (tmp_path / "mine.toml").read_text("utf-8")
    body, _, _ = text.partition("\n[sources]")
    keys = [line for line in body.splitlines() if re.match(r"\w+ = ", line)]
    assert len(keys) > 20
    for line in keys:
        key, value, comment = re.fullmatch(r"(\w+) = (.*?) +# (.+)", line).groups()  # type: ignore[union-attr]
        unit = re.search(r'"[0-9.e-]+ ([^"]+)"', value)
        assert unit is None or comment.startswith(f"[{unit[1]}] "), key
    assert "docs/dimensions.svg" in text
    assert all(f"#   {line}".rstrip() in text for line in sketch(joint_type).splitlines())
    inst = tn.load("mine.toml")
    assumed = {key for key, source in inst.sources.items() if source.startswith(ASSUMED)}
    assert assumed == set(inst.sources)
    assert {"stem_diameter", "tendon_modulus", "friction.vertex_coefficient", "dynamics.tip_inertia"} <= assumed


@pytest.mark.parametrize("rope", ROPES)
def test_a_rope_is_known_by_name(tenodesis: Run, rope: str) -> None:
    assert tenodesis("new", "mine", "--defaults", "--rope", rope.upper())[0] == 0
    inst = tn.load("mine.toml")
    assert inst.tendon_modulus == inst.replace(tendon_modulus=ROPES[rope].modulus).tendon_modulus
    assert rope in inst.sources["tendon_modulus"]


def test_answers_are_asked_for_again_until_they_are_right(tenodesis: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, "gears", "pulley", "3", "-1", "7 mm", "0.8 in", "300", "1 kg", "0.45 mm", "")
    code, said, wrong = tenodesis("new", "mine")
    assert (code, wrong) == (0, "")
    assert "one of tendon-gear, tendon-pulley, continuum" in said
    assert "proximal_pulley_radius = '-1 mm': it must be a length above" in said
    assert "'1 kg': it is measured in kg" in said
    inst = tn.load("mine.toml")
    held = si(inst)
    assert held["distal_pulley_radius"] == pytest.approx(3e-3)
    assert held["proximal_pulley_radius"] == pytest.approx(7e-3)
    assert held["end_effector_length"] == pytest.approx(0.8 * 25.4e-3)
    assert held["overall_length"] == pytest.approx(0.3)
    assert inst.sources["pretension"].startswith(ASSUMED)
    assert inst.sources["overall_length"] == "yours"


def test_loads_and_ranges_of_ones_own_are_taken(tenodesis: Run) -> None:
    more = ("--load", "3 N", "--load", "0.2 N", "--handle-range", "60 deg", "--output-range", "70 deg")
    assert tenodesis("new", "mine", "--defaults", *more, "--stem-diameter", "8 mm", "--handle-length", "9 cm")[0] == 0
    inst = tn.load("mine.toml")
    assert inst.conditions.forces == (3.0, 0.2)
    np.testing.assert_allclose(np.degrees([inst.handle_range, inst.output_range]), (60, 70))
    assert (inst.stem_diameter, inst.handle_length) == (8e-3, 9e-2)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (["--mechanism", "gearbox"], "--mechanism is 'gearbox'; it must be one of tendon-gear"),
        (["--distal-radius", "-2 mm"], "--distal-radius = '-2 mm': it must be a length above"),
        (["--distal-radius", "0 mm"], "--distal-radius = '0 mm': it must be a length above"),
        (["--distal-radius", "nan mm"], "--distal-radius = 'nan mm': it must be a length above"),
        (["--distal-radius", "2"], "--distal-radius = '2': it has no unit"),
        (["--pretension", "30 mm"], "--pretension = '30 mm': it is measured in mm"),
        (["--pretension", "inf N"], "--pretension = 'inf N': it must be a force"),
        (["--load", "1 kg"], "--load = '1 kg': it is measured in kg"),
        (["--load", "-1 N"], "--load = '-1 N': it must be a force above"),
        (["--rope", "hemp"], "--rope is 'hemp'; it must be one of steel"),
        (["--backbone-length", "20 mm"], "--backbone-length is given, which a tendon-pulley does not have"),
        (["--handle-range", "90 mm"], "--handle-range = '90 mm': it is measured in mm"),
        (["--handle-range", "200 deg"], "--handle-range = '200 deg': it must be an angle"),
        (["--stem-diameter", "5"], "--stem-diameter = '5': it has no unit"),
        (["--tendon-diameter", "1 um", "--pretension", "3000 N"], "pretension is 3000 N, which would stretch"),
    ],
)
def test_a_wrong_answer_ends_in_one_sentence_and_no_file(
    tenodesis: Run, tmp_path: Path, change: list[str], sentence: str
) -> None:
    code, _, wrong = tenodesis("new", "mine", "--defaults", *change)
    assert code == 1
    assert sentence in wrong
    assert len(wrong.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_file_that_exists_is_replaced_only_when_asked(tenodesis: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("precious")
    code, _, wrong = tenodesis("new", "mine.toml", "--defaults")
    assert code == 1
    assert "mine.toml exists already" in wrong
    assert (tmp_path / "mine.toml").read_text() == "precious"
    assert tenodesis("new", "mine.toml", "--defaults", "--overwrite")[0] == 0
    assert tn.load("mine.toml").name == "mine"


def test_without_an_answer_it_says_which_option_gives_it(
    tenodesis: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, "pulley", "2 mm")
    code, _, wrong = tenodesis("new", "mine")
    assert code == 1
    assert "give --proximal-radius, or --defaults" in wrong
    assert not list(tmp_path.iterdir())


def test_the_sketch_fits_a_terminal() -> None:
    assert all(len(line) <= 76 for joint_type in JOINT_TYPES for line in sketch(joint_type).splitlines())


# ---------------------------------------------------------------------- loss


def rows(tenodesis: Run, *words: object) -> list[dict[str, Any]]:
    code, said, wrong = tenodesis("loss", *words, "--json")
    assert (code, wrong) == (0, "")
    found: list[dict[str, Any]] = json.loads(said)["rows"]
    return found


@pytest.mark.parametrize("name", ["real", "pulley", "continuum"])
def test_what_a_load_takes_is_what_the_statics_say(
    tenodesis: Run, tmp_path: Path, name: str, request: pytest.FixtureRequest
) -> None:
    inst: Instrument = request.getfixturevalue(name).planar[0]
    (tmp_path / "mine.toml").write_text(tn.instrument.text.to_toml(inst))
    (row,) = rows(tenodesis, "mine.toml", "--load", "0.5 N", "--angle", "30 deg")
    output = np.radians(30.0)
    handle = tn.statics.handle_angle(inst, output)
    loaded = tn.statics.output_angle(inst, handle, 0.5)
    assert row["lost"] == pytest.approx(output - loaded, abs=1e-12)
    assert (row["agonist"], row["antagonist"]) == pytest.approx(tn.statics.tensions(inst, handle, 0.5))
    corrected = handle + row["handle_correction"]
    assert tn.statics.output_angle(inst, corrected, 0.5) == pytest.approx(output, abs=1e-9)
    stroke = row["stroke"]
    held = tn.statics.output_angle(inst, handle, 0.5, wound=(stroke, -stroke))
    if name == "continuum":  # which is brought to where tendons that do not stretch would hold it
        assert held > output
    else:
        assert held == pytest.approx(output, abs=1e-9)


@pytest.mark.parametrize("name", ["real-size", "scaled-up"])
def test_a_tendon_is_slack_from_the_load_that_is_printed_on(tenodesis: Run, name: str) -> None:
    inst = tn.load(name).planar[0]
    for row in rows(tenodesis, name):
        handle = tn.statics.handle_angle(inst, row["output_angle"])
        below, above = (tn.statics.tensions(inst, handle, share * row["slack_force"]) for share in (0.999, 1.001))
        assert below.antagonist > 0
        assert above.antagonist == 0


def test_loads_and_angles_are_those_of_the_file_or_those_asked_for(tenodesis: Run) -> None:
    found = rows(tenodesis, "scaled-up")
    assert sorted({row["force"] for row in found}) == [0.5, 1.0, 1.5]
    np.testing.assert_allclose(np.degrees([row["output_angle"] for row in found[:3]]), (0, 40, 80), atol=1e-9)
    found = rows(tenodesis, "scaled-up", "--load", "2 N", "--load", "30 mN", "--angle", "10 deg")
    assert [row["force"] for row in found] == [2.0, 0.03]


def test_where_there_is_no_solution_json_has_null_and_the_table_a_dash(tenodesis: Run) -> None:
    (row,) = rows(tenodesis, "real-size", "--load", "50 N", "--angle", "80 deg")
    assert row["lost"] is None
    said = tenodesis("loss", "real-size", "--load", "50 N", "--angle", "80 deg")[1]
    assert "–" in said
    assert "the tip cannot be held under that load" in said


def test_the_table_fits_a_terminal_of_80_columns(tenodesis: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(common.console, "width", 80)
    said = tenodesis("loss", "real-size", "--load", "12.34 N", "--angle", "33.3 deg", "--load", "1.234 N")[1]
    assert max(map(len, said.splitlines())) <= 80
    assert "…" not in said
    assert re.search(r"^ +1\.234 +33\.3 +\d+\.\d\d +\d+\.\d\d ", said, re.M)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--load", "2"), "--load = '2': it has no unit"),
        (("--load", "2 mm"), "--load = '2 mm': it is measured in mm"),
        (("--load", "-2 N"), "--load = '-2 N': it must be a force above"),
        (("--load", "nan N"), "--load = 'nan N': it must be a force above"),
        (("--angle", "60"), "--angle = '60': it has no unit"),
        (("--angle", "170 deg"), "--angle is '170 deg'; it must be within ±118.9 deg"),
        (("--axis", "roll"), "real-size has no axis 'roll'; it has yaw and pitch"),
    ],
)
def test_a_wrong_question_ends_in_one_sentence(tenodesis: Run, words: tuple[str, ...], sentence: str) -> None:
    code, _, wrong = tenodesis("loss", "real-size", *words)
    assert code == 1
    assert sentence in wrong
    assert len(wrong.strip().splitlines()) == 1
