"""Claims about what `check` and `loss` say of instruments whose joints share tendons, and what `check` draws."""

import json
import re
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import tenodesis as tn
from tenodesis.cli import common
from tenodesis.errors import Error, InstrumentError

from .chain_samples import LISTED
from .conftest import Command
from .test_cli_own import rows

DRIVER = """
name = "driver"
pretension = "20 N"
tendon_stiffness = "100 N/mm"
joints = [
  { name = "pitch", mechanism = "pulley", axis = "pitch", radius = "2.5 mm" },
  { name = "jaw_1", mechanism = "pulley", axis = "yaw", on = "pitch", radius = "3 mm", offset = "9 mm", \
    end_effector_length = "10 mm" },
  { name = "jaw_2", mechanism = "pulley", axis = "yaw", on = "pitch", radius = "3 mm", offset = "9 mm", \
    end_effector_length = "10 mm" },
]
tendons = [
  { name = "p_up", route = [{ joint = "pitch", side = "agonist" }] },
  { name = "p_down", route = [{ joint = "pitch", side = "antagonist" }] },
  { name = "one_up", route = [
    { joint = "pitch", side = "agonist", radius = "1.5 mm" }, { joint = "jaw_1", side = "agonist" }] },
  { name = "one_down", route = [
    { joint = "pitch", side = "antagonist", radius = "1.5 mm" }, { joint = "jaw_1", side = "antagonist" }] },
  { name = "two_up", route = [
    { joint = "pitch", side = "agonist", radius = "1.5 mm" }, { joint = "jaw_2", side = "agonist" }] },
  { name = "two_down", route = [
    { joint = "pitch", side = "antagonist", radius = "1.5 mm" }, { joint = "jaw_2", side = "antagonist" }] },
]

[grip]
jaws = ["jaw_1", "jaw_2"]
"""
LAST = '{ joint = "jaw_2", side = "antagonist" }'
WRONG = {
    "twice": (
        LAST,
        f'{LAST}, {{ joint = "pitch", side = "agonist" }}',
        "tendon two_down crosses joint pitch twice, as antagonist and as agonist; where it runs back over a pulley "
        "that moves it must be on one side",
    ),
    "unknown": (LAST, '{ joint = "claw", side = "antagonist" }', "tendon two_down: joint = 'claw'; it must be one of"),
    "alone": (LAST, '{ joint = "jaw_2", side = "agonist" }', "joint jaw_2 has no antagonist"),
    "singular": (
        'side = "agonist" }] },\n  { name = "p_down", route = [{ joint = "pitch", side = "antagonist" }] },',
        'side = "agonist", radius = "1.5 mm" }, { joint = "jaw_1", side = "agonist" }] },\n  { name = "p_down", '
        'route = [{ joint = "pitch", side = "antagonist", radius = "1.5 mm" }, '
        '{ joint = "jaw_1", side = "antagonist" }] },',
        "the coupling matrix of pitch, jaw_1, jaw_2 is singular",
    ),
}


@pytest.fixture
def driver(tmp_path: Path) -> tn.instrument.FullForm:
    (tmp_path / "driver.toml").write_text(DRIVER, "utf-8")
    return tn.instrument.parse(DRIVER)


# ---------------------------------------------------------------------- check


@pytest.mark.usefixtures("driver")
def test_check_prints_routes_arms_coupling_and_losses_in_80_columns(
    tenodesis: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(common.console, "width", 80)
    code, said, wrong = tenodesis("check", "driver.toml")
    assert (code, wrong) == (0, "")
    assert max(map(len, said.partition("warning:")[0].splitlines())) <= 80
    assert "driver: 3 joints at the tip, none at the handle, 6 tendons" in said
    assert re.search(r"jaw_2 +pitch +pulley +yaw +3 +±80", said)
    assert "spool → pitch agonist at 1.5 mm → jaw_1" in said
    assert re.search(r"one_down +-1\.5 +-3 +·", said)
    assert re.search(r"p_up +11\.5 +-5\.73 +-5\.73", said)  # 1 mm over 2.5 mm; jaws by -1.5/3 of it
    assert "turning pitch by the tendons that end at joint pitch also turns jaw_1 by -0.5, jaw_2 by -0.5" in said


def test_check_as_json_is_what_python_computes(tenodesis: Command, driver: tn.instrument.FullForm) -> None:
    found = json.loads(tenodesis("check", "driver.toml", "--json")[1])
    np.testing.assert_array_equal(found["arms"], tn.statics.straight_arms(driver))
    np.testing.assert_array_equal(found["coupling"], tn.statics.coupling(driver))
    np.testing.assert_array_equal(found["stiffness"], tn.statics.chain.rates(driver, 0.0).stiffness)
    assert found["tendons"][2]["in_words"] == "spool → pitch agonist at 1.5 mm → jaw_1 agonist at 3 mm → end"
    assert len(found["losses"]["rows"]) == 6


def test_arms_of_gears_are_their_radii(real: tn.Instrument) -> None:
    inst = tn.instrument.expanded(real.replace(axes=["yaw"]))
    np.testing.assert_allclose(tn.statics.straight_arms(inst), [[2e-3], [-2e-3]])
    np.testing.assert_allclose(tn.statics.straight_arms(inst, "handle"), [[4.5e-3], [-4.5e-3]])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"name = \"p_up\"": 'name = "p_up", pretension = "30 N"'}, "the pretensions do not balance: .* pitch at"),
        ({"pretension = \"20 N\"": 'pretension = "0 N"'}, "the joints find no equilibrium under the pretension"),
        ({"pretension = \"20 N\"": 'pretension = "20 N"\nstem_diameter = "5.5 mm"'}, "radius of joint jaw_1 is 3 mm"),
        ({"pretension = \"20 N\"": 'pretension = "20 N"\ntendon_diameter = "1.3 mm"'}, "only 3.8 times"),
        ({"pretension = \"20 N\"": 'pretension = "20 N"\nbreaking_load = "15 N"'}, "break at a breaking_load of 15 N"),
    ],
)  # fmt: skip
def test_what_is_hardly_meant_is_said(changes: dict[str, str], sentence: str) -> None:
    text = DRIVER
    for old, new in changes.items():
        text = text.replace(old, new, 1)
    said = [one.sentence for one in tn.control.implausible(tn.instrument.parse(text))]
    assert any(re.search(sentence, one) for one in said)


def test_a_tendon_that_is_slack_at_rest_is_named() -> None:
    said = [one.sentence for one in tn.control.implausible(tn.instrument.expanded("hybrid-real-size"))]
    assert said == ["slack without a load: grip."]


# ---------------------------------------------------------------------- loss


def test_a_tendon_is_slack_from_the_printed_load_on_and_the_strokes_restore(
    tenodesis: Command, driver: tn.instrument.FullForm
) -> None:
    (row,) = rows(
        tenodesis, "driver.toml", "--load", "0.2 0.5 -1 N", "--moment", "0 0 5 N*mm", "--grip", "1 N", "--angle",
        "20 30 -10 deg",
    )  # fmt: skip
    np.testing.assert_allclose(np.degrees(row["output_angles"]), (20, 30, -10), atol=1e-9)
    handle, strokes = tn.statics.hold(driver, np.radians([20, 30, -10]))
    wrench, grip = np.array(row["wrench"]), row["grip_force"]
    np.testing.assert_allclose(wrench, [0.2, 0.5, -1, 0, 0, 5e-3])
    under = tn.statics.chain.output_angles(driver, handle, wrench, grip_force=grip, strokes=strokes)
    np.testing.assert_allclose(row["lost"], np.array(row["output_angles"]) - under, atol=1e-12)
    tendon = [one.name for one in driver.tendons].index(row["slack_tendon"])
    for share, is_slack in ((0.999, False), (1.001, True)):
        factor = share * row["slack_factor"]
        held = tn.statics.chain.tensions(driver, handle, factor * wrench, grip_force=factor * grip, strokes=strokes)
        assert (held[tendon] == 0) is np.bool_(is_slack)
    wound = strokes + np.array(row["strokes"])
    back = tn.statics.chain.output_angles(driver, handle, wrench, grip_force=grip, strokes=wound)
    np.testing.assert_allclose(back, row["output_angles"], atol=1e-9)


VALUES = ["joint_type", "axes", "values", "derived", "resolution"]
JOINTS = ["joints", "tendons", "arms", "handle_arms", "coupling", "stiffness", "by_handle", "losses"]


@pytest.mark.parametrize("name", tn.shipped())
def test_json_has_the_keys_of_the_form_that_the_file_has(tenodesis: Command, name: str) -> None:
    listed = name in LISTED
    checked = json.loads(tenodesis("check", name, "--json")[1])
    assert list(checked) == ["name", "description", *(JOINTS if listed else VALUES), "warnings"]
    lost = json.loads(tenodesis("loss", name, "--json")[1])
    assert list(lost) == ["instrument", "joints", "tendons", "units", "rows"]
    of_row = list(tn.statics.Loss._fields)
    assert [*lost["units"]] == of_row and all(list(row) == of_row for row in lost["rows"])


@pytest.mark.parametrize("name", LISTED)
def test_every_shipped_instrument_is_held_and_has_losses(tenodesis: Command, name: str) -> None:
    found = rows(tenodesis, name)
    # at the end of its range a hybrid snaps through
    assert len(found) == 9
    assert all(None not in row["lost"] for row in found[:6])


def test_a_grip_is_refused_where_there_is_none(declined: Callable[..., Error], tmp_path: Path) -> None:
    (tmp_path / "open.toml").write_text(DRIVER.partition("[grip]")[0], "utf-8")
    assert declined("loss", "open.toml", "--grip", "1 N").key == "--grip"


def test_what_takes_planar_instruments_says_which_commands_take_such_files() -> None:
    takers = "check, loss, compare, bench, record, replay, console, devices test, scale, tolerance"
    with pytest.raises(InstrumentError, match=f"takes planar instruments; tenodesis {takers}") as found:
        common.load_instrument("needle-driver", planar=True)
    assert found.value.key == "file"


# ---------------------------------------------------------------------- picture


@pytest.mark.usefixtures("driver")
def test_the_picture_names_every_joint_tendon_and_radius(tenodesis: Command, tmp_path: Path) -> None:
    code, said, _ = tenodesis("check", "driver.toml", "--picture", "driver.svg")
    assert code == 0
    assert "driver.svg is written." in said
    texts = re.findall(r">([^<>]+)</text>", (tmp_path / "driver.svg").read_text("utf-8"))
    assert {"pitch", "jaw_1", "jaw_2"} <= set(texts)
    assert {"p_up", "p_down", "one_up", "one_down", "two_up", "two_down"} <= set(texts)
    assert [texts.count(radius) for radius in ("2.5", "1.5", "3")] == [2, 4, 4]
    assert tenodesis("check", "driver.toml", "--picture", "driver.svg")[0] == 1


@pytest.mark.parametrize("name", [*LISTED, "real-size"])
def test_no_label_of_a_picture_covers_another(name: str) -> None:
    figure = tn.plot.routing(tn.load(name) if name == "real-size" else name)
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = [text.get_window_extent(renderer).padded(-0.5) for axis in figure.axes for text in axis.texts]
    assert not [pair for pair in combinations(boxes, 2) if pair[0].overlaps(pair[1])]
    assert all(box.x0 > 0 and box.y0 > 0 and box.x1 < figure.bbox.x1 and box.y1 < figure.bbox.y1 for box in boxes)


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_route_ends_in_one_sentence_with_the_picture_of_it(
    tenodesis: Command, tmp_path: Path, kind: str
) -> None:
    old, new, sentence = WRONG[kind]
    assert old in DRIVER
    (tmp_path / "wrong.toml").write_text(DRIVER.replace(old, new), "utf-8")
    code, said, wrong = tenodesis("check", "wrong.toml", "--picture", "wrong.svg")
    assert code == 1
    assert wrong.startswith(f"tenodesis: wrong.toml: {sentence}")
    assert len(wrong.strip().splitlines()) == 1
    assert "wrong.svg is written, with what is wrong in red." in said
    picture = (tmp_path / "wrong.svg").read_text("utf-8")
    assert "Wrong: " in picture
    assert "#d00000" in picture
    assert ("not listed" in picture) is (kind == "unknown")


def test_what_is_no_route_error_is_not_drawn(tenodesis: Command, tmp_path: Path) -> None:
    (tmp_path / "wrong.toml").write_text(DRIVER.replace('"2.5 mm"', '"2.5 N"'), "utf-8")
    code, _, wrong = tenodesis("check", "wrong.toml", "--picture", "wrong.svg")
    assert code == 1
    assert "joint 1 (pitch): radius = '2.5 N'" in wrong
    assert not (tmp_path / "wrong.svg").exists()
