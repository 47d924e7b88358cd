"""Claims about the commands for an instrument of one's own: `new` writes a file that holds, `loss` answers at once."""

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.cli import common, new
from tenodesis.control.plausibility import implausible
from tenodesis.errors import InstrumentError
from tenodesis.instrument import JOINT_TYPES, Instrument, as_short_form
from tenodesis.instrument.template import ASSUMED, QUESTIONS, ROPES, sketch
from tenodesis.instrument.template import text as text_of
from tenodesis.instrument.text import to_toml

from .conftest import EXAMPLES, Command

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
def test_a_new_file_is_the_instrument_that_was_described(tenodesis: Command, joint_type: str) -> None:
    code, said, wrong = tenodesis("new", "mine", *options(joint_type))
    assert (code, wrong) == (0, "")
    assert "mine.toml" in said
    inst = tn.load("mine.toml")
    assert (inst.name, inst.joint_type) == ("mine", joint_type)
    for one in QUESTIONS[joint_type]:
        assert si(inst)[one.key] == pytest.approx(si(inst.replace(**{one.key: GIVEN[one.option]}))[one.key], rel=1e-12)
        assert inst.sources[one.key] == "yours"
    again = tn.parse(to_toml(inst))
    assert again == inst
    assert implausible(inst) == ()
    assert tenodesis("check", "mine.toml")[0] == 0


def test_a_stiff_continuum_that_bends_less_than_its_stop_is_written(tenodesis: Command) -> None:
    given = {
        "distal-radius": "2.1 mm",
        "proximal-radius": "5 mm",
        "backbone-length": "42 mm",
        "backbone-rigidity": "0.004 N*m^2",
        "end-effector-length": "8 mm",
        "overall-length": "710 mm",
        "tendon-diameter": "0.45 mm",
        "pretension": "15 N",
        "rope": "steel",
        "stem-diameter": "6 mm",
    }
    stated = [part for option, value in given.items() for part in (f"--{option}", value)]
    code, _, wrong = tenodesis("new", "stiff", "--mechanism", "continuum", *stated)
    assert (code, wrong) == (0, "")
    assert tn.load("stiff.toml").sources["backbone_rigidity"] == "yours"


@pytest.mark.parametrize("joint_type", JOINT_TYPES)
def test_the_defaults_are_an_instrument_without_warnings_that_can_be_run(tenodesis: Command, joint_type: str) -> None:
    assert tenodesis("new", "mine", "--mechanism", joint_type, "--defaults")[0] == 0
    inst = tn.load("mine.toml")
    assert implausible(inst) == ()
    assert tn.statics.output_angle(inst, tn.statics.reach(inst)) == pytest.approx(inst.output_range, abs=1e-9)
    tn.twin.Twin(inst, seed=1).run(np.linspace(0, 0.1, 100))


@pytest.mark.parametrize("joint_type", JOINT_TYPES)
def test_every_key_of_a_new_file_has_a_comment_and_a_source(
    tenodesis: Command, tmp_path: Path, joint_type: str
) -> None:
    tenodesis("new", "mine", "--mechanism", joint_type, "--defaults")
    text = (tmp_path / "mine.toml").read_text("utf-8")
    body, _, _ = text.partition("\n[sources]")
    keys = [line for line in body.splitlines() if re.match(r"\w+ = ", line)]
    assert len(keys) > 20
    for line in keys:
        key, value, comment = re.fullmatch(r"(\w+) = (.*?) +# (.+)", line).groups()  # type: ignore[union-attr]
        unit = re.search(r'"[0-9.e-]+ ([^"]+)"', value)
        assert unit is None or comment.startswith(f"[{unit[1]}] "), key
    assert "`tenodesis schema`" in text
    assert all(f"#   {line}".rstrip() in text for line in sketch(joint_type).splitlines())
    inst = tn.load("mine.toml")
    assumed = {key for key, source in inst.sources.items() if source.startswith(ASSUMED)}
    assert assumed == set(inst.sources)
    assert {"stem_diameter", "tendon_modulus", "friction.vertex_coefficient", "dynamics.tip_inertia"} <= assumed


@pytest.mark.parametrize("rope", ROPES)
def test_a_rope_is_known_by_name(tenodesis: Command, rope: str) -> None:
    assert tenodesis("new", "mine", "--defaults", "--rope", rope.upper())[0] == 0
    inst = tn.load("mine.toml")
    assert inst.tendon_modulus == inst.replace(tendon_modulus=ROPES[rope].modulus).tendon_modulus
    assert rope in inst.sources["tendon_modulus"]


def test_a_backbone_is_known_by_its_rod(tenodesis: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, "continuum", "", "", "", "0.6 mm gold", "0.6 mm Nitinol", "", "", "", "")
    code, said, _ = tenodesis("new", "asked")
    assert code == 0 and "of nitinol, steel, stainless" in said
    code, _, wrong = tenodesis("new", "given", *options("continuum", **{"backbone-rigidity": "0.6 mm nitinol"}))
    assert (code, wrong) == (0, "")
    for name in ("asked", "given"):
        inst = as_short_form(tn.load(f"{name}.toml"))
        assert inst.backbone_rigidity == pytest.approx(60e9 * np.pi * 0.6e-3**4 / 64, rel=1e-3)
        assert inst.sources["backbone_rigidity"].startswith("yours: a rod of 0.6 mm")


def test_answers_are_asked_for_again_until_they_are_right(tenodesis: Command, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_an_implausible_answer_is_asked_for_once_more(tenodesis: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    for again, kept in (("0.4", 0.4e-3), ("", 3e-3)):
        answering(monkeypatch, *[""] * 5, "3", "", again)
        code, said, wrong = tenodesis("new", "mine", "--overwrite")
        assert (code, wrong) == (0, "")
        assert said.count("(tendon_diameter) [") == 2
        assert said.count("warning: tendon_diameter is 3 mm") == (1 if again else 2)
        inst = tn.load("mine.toml")
        assert (inst.tendon_diameter, inst.sources["tendon_diameter"]) == (pytest.approx(kept), "yours")


def test_loads_and_ranges_of_ones_own_are_taken(tenodesis: Command) -> None:
    more = ("--load", "3 N", "--load", "0.2 N", "--handle-range", "60 deg", "--output-range", "70 deg")
    assert tenodesis("new", "mine", "--defaults", *more, "--stem-diameter", "8 mm", "--handle-length", "9 cm")[0] == 0
    inst = tn.load("mine.toml")
    assert inst.conditions.forces == (3.0, 0.2)
    np.testing.assert_allclose(np.degrees([inst.handle_range, inst.output_range]), (60, 70))
    assert (inst.stem_diameter, inst.handle_length) == (8e-3, 9e-2)


def test_an_implausible_answer_is_taken_with_a_warning(tenodesis: Command) -> None:
    code, said, _ = tenodesis("new", "mine", "--defaults", "--distal-radius", "3 mm", "--stem-diameter", "5 mm")
    assert code == 0
    assert "warning: distal_pulley_radius is 3 mm, so that the joint is 6 mm wide" in said


def test_without_an_answer_it_says_which_option_gives_it(
    tenodesis: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, "pulley", "2 mm")
    code, _, wrong = tenodesis("new", "mine")
    assert code == 1
    assert "give --proximal-radius, or --defaults" in wrong
    assert not list(tmp_path.iterdir())


def test_a_number_that_nobody_gave_is_refused_with_the_options_it_follows_from(tenodesis: Command) -> None:
    code, _, said = tenodesis("new", "own", "--defaults", "--distal-radius", "50 m")
    assert code and "stem_diameter = '100001 mm'" in said.replace("\n", " ")
    assert "it follows from --distal-radius." in " ".join(said.split())
    refusal = InstrumentError("pretension is 9 N; it must be less.", key="pretension", value=9.0, allowed="less")
    assert str(new._named(refusal, {"pretension": "pretension"}, [])).startswith("--pretension: pretension is 9 N")


# ---------------------------------------------------------------------- loss


def rows(tenodesis: Command, *words: object) -> list[dict[str, Any]]:
    code, said, wrong = tenodesis("loss", *words, "--json")
    assert (code, wrong) == (0, "")
    found: list[dict[str, Any]] = json.loads(said)["rows"]
    return found


@pytest.mark.parametrize("name", ["real", "pulley", "continuum"])
def test_what_a_load_takes_is_what_the_statics_say(
    tenodesis: Command, tmp_path: Path, name: str, request: pytest.FixtureRequest
) -> None:
    inst: Instrument = request.getfixturevalue(name).planar[0]
    (tmp_path / "mine.toml").write_text(to_toml(inst))
    (row,) = rows(tenodesis, "mine.toml", "--load", "0.5 N", "--angle", "30 deg")
    output = np.radians(30.0)
    handle = tn.statics.handle_angle(inst, output)
    loaded = tn.statics.output_angle(inst, handle, 0.5)
    assert row["lost"] == pytest.approx([output - loaded], abs=1e-12)
    assert row["loaded_angles"] == pytest.approx([loaded], abs=1e-12)
    assert row["tensions"] == pytest.approx([*tn.statics.tensions(inst, handle, 0.5)])
    corrected = handle + row["handle_corrections"][0]
    assert tn.statics.output_angle(inst, corrected, 0.5) == pytest.approx(output, abs=1e-9)
    held = tn.statics.output_angle(inst, handle, 0.5, wound=tuple(row["strokes"]))
    assert held == pytest.approx(output, abs=1e-9)


def test_a_moment_turns_a_pulley_by_its_flexural_stiffness(
    tenodesis: Command, pulley: Instrument, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text(to_toml(pulley))
    (row, *_) = rows(tenodesis, "mine.toml", "--load", "0 0 0 N", "--moment", "0 -20 0 N*mm")
    assert row["lost"] == pytest.approx([0.02 / tn.statics.flexural_stiffness(pulley, 0.0)])


@pytest.mark.parametrize("name", ["real-size", "scaled-up"])
def test_a_tendon_is_slack_from_the_load_that_is_printed_on(tenodesis: Command, name: str) -> None:
    inst = tn.load(name).planar[0]
    for row in rows(tenodesis, name, "--axis", "yaw"):
        (output,), force = row["output_angles"], -row["slack_factor"] * row["wrench"][0]
        handle = tn.statics.handle_angle(inst, output)
        assert force == pytest.approx(tn.statics.slack_load(inst, handle), rel=1e-9)
        below, above = (tn.statics.tensions(inst, handle, share * force) for share in (0.999, 1.001))
        assert below.antagonist > 0
        assert above.antagonist == 0


def test_loads_and_angles_are_those_of_the_file_or_those_asked_for(tenodesis: Command) -> None:
    found = rows(tenodesis, "scaled-up")
    assert sorted({-row["wrench"][0] for row in found}) == [0.5, 1.0, 1.5]
    np.testing.assert_allclose(np.degrees([row["output_angles"] for row in found[::3]]).T, [(0, 40, 80)], atol=1e-9)
    found = rows(tenodesis, "scaled-up", "--load", "2 N", "--load", "30 mN", "--angle", "10 deg")
    assert [-row["wrench"][0] for row in found] == [2.0, 0.03]


def test_where_there_is_no_solution_json_has_null_and_the_table_a_dash(tenodesis: Command) -> None:
    (row,) = rows(tenodesis, "real-size", "--axis", "yaw", "--load", "50 N", "--angle", "80 deg")
    assert row["lost"] == [None]
    said = tenodesis("loss", "real-size", "--axis", "yaw", "--load", "50 N", "--angle", "80 deg")[1]
    assert "–" in said
    assert "the tip cannot be held under that load" in said
    both = rows(tenodesis, "real-size", "--load", "50 N", "--angle", "80 deg")
    assert [row["lost"] for row in both] == [[None, None], [None, None]]


def test_the_table_fits_a_terminal_of_80_columns(tenodesis: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(common.console, "width", 80)
    words = ("--load", "12.34 N", "--angle", "33.3 deg", "--load", "1.234 N")
    for axis in ((), ("--axis", "yaw")):
        said = tenodesis("loss", "real-size", *axis, *words)[1]
        assert max(map(len, said.splitlines())) <= 80
        assert "…" not in said
    assert re.search(r"^ yaw falls to \[°\] +– +-?\d+\.\d\d ", said, re.M)


# ---------------------------------------------------------------------- check


def checked(tenodesis: Command, text: str) -> dict[str, Any]:
    """Return what `check` says as JSON about a file with this text."""
    Path("mine.toml").write_text(text, "utf-8")
    code, said, wrong = tenodesis("check", "mine.toml", "--json")
    assert (code, wrong) == (0, "")
    found: dict[str, Any] = json.loads(said)
    return found


def test_check_prints_values_as_the_file_has_them(tenodesis: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(common.console, "width", 80)
    text = (EXAMPLES / "pulley.toml").read_text("utf-8")
    text = text.replace('"25 mm"', '"2.5 cm"').replace('"50 GPa"', '"50000 MPa"')
    Path("mine.toml").write_text(text.replace('"4 N"]', '"4 N", "5 N", "6.125 N", "7 N", "8 N"]'), "utf-8")
    code, said, _ = tenodesis("check", "mine.toml")
    assert code == 0
    table = said.partition("The sensors")[0]
    assert max(map(len, table.splitlines())) <= 80
    assert "…" not in table
    for shown in ("end_effector_length +2.5 cm", "tendon_modulus +50000 MPa", "output_range +80 deg +default"):
        assert re.search(shown, table)
    assert all(f"{force} N" in table for force in ("0.5", "6.125", "8"))
    for part in ("[friction]", "[drives]", "[sensors]", "[control]", "spool_radius", "load_cell_range", "dead_band"):
        assert part in table
    for derived in ("tendon stiffness +31172 N/m", "reach +35.56 deg", "natural frequency +20 Hz"):
        assert re.search(derived, table)


def test_check_as_json_has_the_values_in_si_and_what_follows(tenodesis: Command) -> None:
    found = checked(tenodesis, (EXAMPLES / "pulley.toml").read_text("utf-8"))
    inst = tn.load("mine.toml")
    held = {key: one["value"] for key, one in found["values"].items()}
    assert held["tendon_modulus"] == 50e9
    assert held["conditions.forces"] == [0.5, 1, 2, 4]
    assert held["sensors.load_cell_range"] == 200
    assert found["values"]["pretension"] == {
        "text": "30 N", "value": 30, "unit": "N", "given": True, "source": ""
    }  # fmt: skip
    assert found["values"]["drives.gear_ratio"]["given"] is False
    assert found["derived"]["reach"]["value"] == pytest.approx(tn.statics.reach(inst))
    assert found["derived"]["tendon_stiffness"]["value"] == pytest.approx(inst.tendon_stiffness)
    assert found["resolution"][0].startswith("The sensors resolve")
    assert [one["key"] for one in found["warnings"]] == ["dynamics.tip_inertia"]


def test_an_axis_with_values_of_its_own_is_listed(tenodesis: Command) -> None:
    text = (
        (EXAMPLES / "pulley.toml")
        .read_text("utf-8")
        .replace('"tendon-pulley"', '"tendon-pulley"\naxes = ["yaw", "pitch"]')
    )
    found = checked(tenodesis, text + '[overrides.pitch]\nend_effector_length = "18 mm"\n')
    assert found["values"]["pitch: end_effector_length"]["value"] == pytest.approx(0.018)
    assert found["derived"]["pitch: slack_force"]["value"] > found["derived"]["yaw: slack_force"]["value"]


SOUND = """
name = "sound"
joint_type = "tendon-pulley"
overall_length = "500 mm"
distal_pulley_radius = "2 mm"
proximal_pulley_radius = "4.5 mm"
end_effector_length = "25 mm"
handle_length = "120 mm"
stem_diameter = "5 mm"
tendon_diameter = "0.63 mm"
tendon_modulus = "50 GPa"
pretension = "30 N"
handle_range = "45 deg"
[conditions]
forces = ["0.5 N", "1 N"]
[dynamics]
tip_inertia = "6e-7 kg*m^2"
"""

# A change of a sound file, the key that is implausible, and what is said of it.
IMPLAUSIBLE = {
    "soft rope": (('"50 GPa"', '"120 MPa"'), "tendon_modulus", "tendon_modulus is 120 MPa; ropes have 1 to 250 GPa"),
    "hard rope": (('"50 GPa"', '"900 GPa"'), "tendon_modulus", "tendon_modulus is 900 GPa"),
    "wide pulley": (('"2 mm"', '"3 mm"'), "stem_diameter", "6 mm wide, wider than the stem of 5 mm"),
    "wide rope": (('"0.63 mm"', '"2.6 mm"'), "tendon_diameter", "two tendons fill the stem of 5 mm"),
    "rope on a small pulley": (('"0.63 mm"', '"1.2 mm"'), "tendon_diameter", "on a pulley of only 3.3 times"),
    "length in the wrong unit": (('"500 mm"', '"5 m"'), "overall_length", "overall_length is 5000 mm"),
    "no stem left": (('"500 mm"', '"140 mm"'), "overall_length", "so that no stem is left"),
    "no pretension": (('"30 N"', '"0 N"'), "pretension", "a tendon is slack under any load"),
    "little pretension": (('"30 N"', '"2 N"'), "pretension", "goes slack at 0.32 N at the tip already"),
    "stress": (('"30 N"', '"400 N"'), "pretension", "a stress of 1.28 GPa in a tendon of 0.63 mm"),
    "stretch": (('"50 GPa"', '"1.2 GPa"'), "pretension", "stretches a tendon by 8.02 % of its length"),
    "wound stress": (("[conditions]", '[control]\ntension_limit="700 N"\n[conditions]'), "pretension", "2.25 GPa"),
    "tight, but sound": (("handle_range", 'breaking_load = "200 N"\nhandle_range'), "", ""),
    "limit over the breaking load": (
        ("[conditions]", 'breaking_load = "60 N"\n[control]\ntension_limit = "70 N"\n[conditions]'),
        "control.tension_limit", "tendons break at a breaking_load of 60 N"),
    "short of its range": (('"45 deg"', '"20 deg"'), "handle_range", "bends the unloaded tip by 45 deg only"),
    "at the joint's end": (('"45 deg"', '"79.99999999 deg"'), "handle_range", "180 deg, all that its joint can"),
    "too much load": (('"1 N"', '"500 N"'), "conditions.forces", "has 500 N, which the tip cannot"),
    "no bend": (
        ("[dynamics]", '[friction]\nlaw="capstan"\nvertex_coefficient=0.1\nsheath_coefficient=0.1\n[dynamics]'),
        "friction.sheath_coefficient", "without a bend it has no effect"),
    "no coefficient at the bend": (
        ("[dynamics]", '[friction]\nlaw="capstan"\nvertex_coefficient=0.1\nsheath_bend="20 deg"\n[dynamics]'),
        "friction.sheath_coefficient", "without friction.sheath_coefficient it has no effect"),
    "no coefficient": (("[dynamics]", '[friction]\nlaw="capstan"\n[dynamics]'), "friction.law", "there is no friction"),
    "rough": (
        ("[dynamics]", '[friction]\nlaw="capstan"\nvertex_coefficient=1.1\n[dynamics]'),
        "friction.vertex_coefficient", "friction.vertex_coefficient is 1.1"),
    "no inertia": (('tip_inertia = "6e-7 kg*m^2"', ""), "dynamics.tip_inertia", "swings at 20 Hz: 1.6e-05 kg*m^2, 20"),
    "heavy": (("6e-7", "3e-4"), "dynamics.tip_inertia", "with which the tip swings at 4.59 Hz"),
    "slow motor": (
        ("[dynamics]", '[drives]\nmotor_speed = "20 deg/s"\n[dynamics]'),
        "drives.motor_speed", "the spools wind 1.7 mm/s; a hand at 60 deg/s moves the tendons by 4.7 mm/s"),
    "speed beyond the motor's": (
        ("[dynamics]", '[control]\ntendon_speed = "500 mm/s"\n[dynamics]'), "drives.motor_speed", "wind 100 mm/s"),
    "small load cell": (
        ("[dynamics]", '[sensors]\nload_cell_range = "25 N"\n[dynamics]'),
        "sensors.load_cell_range", "which the pretension of 30 N takes up already"),
    "load cell with little room": (
        ("[dynamics]", '[sensors]\nload_cell_range = "40 N"\n[dynamics]'), "sensors.load_cell_range", "leaves little"),
    "load cell below the limit": (
        ("[dynamics]", '[sensors]\nload_cell_range = "70 N"\n[control]\ntension_limit = "75 N"\n[dynamics]'),
        "sensors.load_cell_range", "below control.tension_limit, 75 N"),
    "coarse encoder": (
        ("[dynamics]", '[sensors]\nencoder_bits = 5\n[dynamics]'), "sensors", "motors would do as much harm as good"),
    "not to be simulated": (("6e-7", "1e-8"), "dynamics.tip_inertia", "can be neither run live nor simulated"),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPLAUSIBLE)
def test_what_is_implausible_is_said_in_one_sentence(name: str) -> None:
    (old, new), key, sentence = IMPLAUSIBLE[name]
    assert old in SOUND
    found = implausible(tn.parse(SOUND.replace(old, new, 1)))
    assert all(one.sentence.endswith(".") and "\n" not in one.sentence for one in found)
    if not key:
        assert not found
        return
    assert [one for one in found if one.key == key and sentence in one.sentence], found


def test_sound_instruments_are_called_plausible(real: Instrument, scaled: Instrument) -> None:
    for inst in (tn.parse(SOUND), real, scaled):
        assert implausible(inst) == ()


def test_implausible_files_are_listed_with_exit_code_0(tenodesis: Command) -> None:
    Path("mine.toml").write_text(SOUND.replace('"50 GPa"', '"120 MPa"').replace('"2 mm"', '"3 mm"'), "utf-8")
    code, said, _ = tenodesis("check", "mine.toml")
    assert code == 0
    assert "warning: tendon_modulus is 120 MPa" in said
    assert "warning: distal_pulley_radius is 3 mm" in said


def test_info_as_json_has_what_info_prints(tenodesis: Command, scaled: Instrument, tmp_path: Path) -> None:
    with tn.Recorder(tmp_path / "run.mcap", axes=("yaw",)) as recorder:
        recorder.write(tn.twin.Twin(scaled).run(np.linspace(0, 0.1, 100)))
    code, said, _ = tenodesis("info", "run.mcap", "--json")
    assert code == 0
    (found,) = json.loads(said)
    assert (found["file"], found["rows"], found["damage"]) == ("run.mcap", 100, None)
    recorded = tn.Recording.open("run.mcap").run
    handle = found["signals"]["measured_handle_angle.yaw"]
    assert handle["unit"] == "deg"
    assert handle["greatest"] == pytest.approx(np.degrees(recorded.measured_handle_angle.max()))
    printed = tenodesis("info", "run.mcap")[1]
    assert all(name in printed for name in (*found["topics"], *found["signals"]))


def test_a_pretension_that_is_too_low_is_named_with_one_that_is_enough() -> None:
    file = text_of(
        "bender", "continuum",
        {
            "distal_tendon_offset": "1.2mm", "proximal_pulley_radius": "4.5 mm", "backbone_length": "25 mm",
            "backbone_rigidity": "2e-4 N*m^2", "end_effector_length": "6 mm", "overall_length": "400 mm",
            "tendon_diameter": "0.3 mm", "pretension": "4 N", "tendon_modulus": "54.2 GPa", "handle_length": "96 mm",
            "handle_range": "38 deg", "output_range": "80 deg", "conditions.forces": ("0.5 N",),
        },
        {},
    )  # fmt: skip
    assert "# [mm] Distance of a tendon from the backbone" in file
    inst = as_short_form(tn.instrument.parse(file, "bender.toml"))
    (said,) = [one.sentence for one in implausible(inst) if one.key == "pretension"]
    assert "slack without a load" in said
    found = re.search(r"a pretension of ([0-9.]+) N keeps them taut up to 0.5 N", said)
    assert found is not None
    enough = float(found[1])
    assert not [one for one in implausible(inst.replace(pretension=enough)) if one.key == "pretension"]
    assert [one for one in implausible(inst.replace(pretension=0.98 * enough)) if one.key == "pretension"]
