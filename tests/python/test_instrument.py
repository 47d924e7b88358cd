"""Claims about instrument files: what is shipped, and that every bad one ends in a sentence that helps."""

import json
import pickle
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import units
from tenodesis.instrument import Continuum, Instrument, TendonGear, json_schema

from .conftest import EXAMPLES, ROOT, refused

TEXT = (ROOT / "instruments/real-size.toml").read_text("utf-8")


def test_shipped_instruments_hold_all_of_table_1_with_sources(real: TendonGear, scaled: TendonGear) -> None:
    table = {
        "stem_diameter": (5e-3, 18.75e-3),
        "overall_length": (0.5, 1.0),
        "distal_gear_radius": (2e-3, 7.5e-3),
        "proximal_gear_radius": (4.5e-3, 16.875e-3),
        "end_effector_length": (50e-3, 86e-3),
        "handle_length": (120e-3, 160e-3),
        "tendon_diameter": (0.63e-3, 0.54e-3),
        "tendon_modulus": (50e9, 50e9),
    }
    for key, values in table.items():
        for inst, value in zip((real, scaled), values, strict=True):
            assert getattr(inst, key) == pytest.approx(value, rel=1e-14)
            assert inst.sources[key] == "Table I"
    for inst in (real, scaled):
        given = [key for key, _, _ in inst.quantities() if key != "tendon_stiffness"]
        assert [key for key in given if key not in inst.sources] == []
    conditions = scaled.conditions
    for key in conditions.model_fields_set:
        assert f"conditions.{key}" in scaled.sources
    assert conditions.forces == (0.5, 1.0, 1.5)
    assert conditions.sampling_rate == 2000
    assert scaled.pretension == 25
    assert real.pretension == 30


BAD = [
    (
        "overall_length =",
        "over_all_length =",
        "over_all_length is not a known key (did you mean overall_length?); it must be one of ",
    ),
    ('pretension = "30 N"', "pretension = 30", "pretension = 30: it has no unit; write a force of at least 0 N"),
    ('"2 mm"', '"2"', "distal_gear_radius = '2': it has no unit"),
    ('"2 mm"', '"2 kg"', "distal_gear_radius = '2 kg': it is measured in kg; it must be a length above 1e-07 m"),
    ('"2 mm"', '"-2 mm"', "distal_gear_radius = '-2 mm': it must be a length above 1e-07 m"),
    ('"2 mm"', '"nan mm"', "distal_gear_radius = 'nan mm': it must be a length above 1e-07 m"),
    ('"2 mm"', '"two mm"', "distal_gear_radius = 'two mm': it is not understood"),
    ('"2 mm"', "nan", "distal_gear_radius = nan: it has no unit"),
    ('"2 mm"', "true", "distal_gear_radius = True: it must be a length above 1e-07 m"),
    ('"50 GPa"', '"0 GPa"', "tendon_modulus = '0 GPa': it must be a modulus above 1000 Pa"),
    ('pretension = "30 N"', "", "pretension is missing"),
    ('tendon_modulus = "50 GPa"', "", "tendon_modulus is missing; give tendon_diameter and tendon_modulus, or"),
    ('"45 deg"', '"60 deg"', "handle_range is 60 deg, which would bend the distal joint 1.125 times as far as it can"),
    ('"45 deg"', '"270 deg"', "handle_range = '270 deg': it must be an angle above 0 rad and below 3.14159 rad"),
    ('"yaw", "pitch"', '"yaw", "roll"', "axes (value 2) = 'roll': it must be 'yaw' or 'pitch'"),
    ('"yaw", "pitch"', '"yaw", "yaw"', "axes = ['yaw', 'yaw']: it must name one or two different axes"),
    ('"tendon-gear"', '"gear"', "joint_type is 'gear'; it must be one of tendon-gear, tendon-pulley, continuum"),
    ('joint_type = "tendon-gear"', "", "joint_type is missing; it must be one of"),
    (
        "forces = [",
        "force = [",
        "conditions.force is not a known key (did you mean conditions.forces?); it must be one of forces",
    ),
    (
        'pretension = "Fig. 7"',
        'pretensoin = "Fig. 7"',
        "sources.pretensoin names no key of an instrument (did you mean pretension?)",
    ),
    ('axes = ["yaw", "pitch"]', 'axes = ["yaw"]\noverrides = {pitch = {}}', "but the second axis is not there"),
    ("[conditions]", "[overrides.yaw]\n[conditions]", "overrides.yaw is given, but the second axis is pitch"),
    ("[conditions]", '[overrides.pitch]\naxes = ["yaw"]\n[conditions]', "overrides.pitch: axes is not a known key"),
    ('"45 deg"', '"80 percent"', "handle_range = '80 percent': it is measured in percent; it must be an angle"),
    ('"50 mm"', '"12,5 mm"', "end_effector_length = '12,5 mm': it has a decimal comma"),
    ('"30 N"', '"9**9**9**9 N"', "pretension = '9**9**9**9 N': it is not understood"),
    ('"0.63 mm"', '"1e200 m"', "tendon_diameter = '1e200 m': it must be a length above 1e-07 m and below 100 m"),
    ('"50 GPa"', '"1 MPa"', "pretension is 30 N, which would stretch tendons of 0.623 N/m by more than their length"),
    ('"0.5 N", ', '"-1 N", ', "conditions.forces (value 1) = '-1 N': it must be a force above 1e-06 N"),
    ('name = "real-size"', 'name = ""', "name = '': it must be 1 to 60 printable characters"),
    ('["yaw", "pitch"]', '"yaw"', "axes = 'yaw': it must be a list"),
    ("[conditions]", "sheath_coeficient = 0.1\n[conditions]", "(did you mean friction.sheath_coefficient?)"),
    (
        "[conditions]",
        '[overrides.pitch]\npretention = "3 N"\n[conditions]',
        "pretention is not a known key (did you mean p",
    ),
    ("[conditions]", "conditions = 3\n[x]", "conditions = 3: it must be"),
]


@pytest.mark.parametrize(("good", "bad", "sentence"), BAD)
def test_a_bad_file_ends_in_a_sentence_that_names_key_value_and_what_is_allowed(
    good: str, bad: str, sentence: str
) -> None:
    assert good in TEXT
    with pytest.raises(tn.InstrumentError) as raised:
        tn.parse(TEXT.replace(good, bad, 1), "my.toml")
    message = str(raised.value)
    assert sentence in message
    assert all(line.startswith("my.toml") and line.endswith(".") for line in message.splitlines())
    assert raised.value.__cause__ is None
    assert raised.value.__suppress_context__ or raised.value.__context__ is None


@pytest.mark.parametrize(
    ("change", "key", "value", "allowed"),
    [
        ({"pretension": "30"}, "pretension", "30", ""),
        ({"handle_range": 4.0}, "handle_range", 4.0, "an angle above 0 rad and below 3.14159 rad"),
        ({"colour": 1}, "colour", 1, "one of name, description"),
        ({"axes": ["yaw", "roll"]}, "axes (value 2)", "roll", "'yaw' or 'pitch'"),
        ({"description": "x" * 201}, "description", "x" * 201, "text of at most 200 characters"),
        ({"conditions": {"forces": [1.0] * 13}}, "conditions.forces", [1.0] * 13, "a list of at most 12"),
        ({"conditions": 3}, "conditions", 3, "a table"),
        ({"friction": {"law": "glue"}}, "friction.law", "glue", "'none', 'capstan'"),
        ({"friction.coefficient": 0.1}, "friction.coefficient", 0.1, "one of law, vertex_coefficient"),
        (
            {"mismatch": {"load_cell_bias": [0.0, 1e9]}},
            "mismatch.load_cell_bias (value 2)",
            1e9,
            "a force above -100000",
        ),
    ],
)
def test_a_mistake_carries_key_value_and_what_is_allowed(
    real: TendonGear, change: dict[str, Any], key: str, value: Any, allowed: str
) -> None:
    with refused(key, value, tn.InstrumentError) as caught:
        real.replace(**change)
    assert caught.value.allowed.startswith(allowed)


def test_a_file_that_cannot_be_read_ends_in_a_sentence(tmp_path: Path) -> None:
    for path, sentence in (
        (tmp_path / "absent.toml", "there is no such file and no instrument of that name; it must be the path"),
        (tmp_path, "there is no such file"),
        (tmp_path / "binary.toml", "is not UTF-8 text"),
        (tmp_path / "\0", "is no path; it must be"),
    ):
        if path.name == "binary.toml":
            path.write_bytes(b"\xff\xfe\x00")
        with pytest.raises(tn.InstrumentError, match=sentence):
            tn.load(path)


def test_replace_takes_si_numbers_and_text_with_units_and_checks_both(real: TendonGear) -> None:
    assert real.replace(pretension=41.3).pretension == 41.3
    assert real.replace(pretension="41.3 N").pretension == 41.3
    assert real.replace(distal_gear_radius="0.2 cm") == real
    with refused("pretension", -1, kind=tn.InstrumentError):
        real.replace(pretension=-1)
    with refused("colour", 1, kind=tn.InstrumentError):
        real.replace(colour=1)
    assert real.pretension == 30


def test_every_joint_type_loads_and_keeps_its_own_keys(pulley: Instrument, continuum: Continuum) -> None:
    assert pulley.joint_type == "tendon-pulley"
    assert continuum.backbone_rigidity == pytest.approx(2e-4)
    with refused("backbone_length", "1 mm", kind=tn.InstrumentError):
        tn.parse((EXAMPLES / "pulley.toml").read_text().replace("pretension", 'backbone_length = "1 mm"\npretension'))


def test_instruments_can_be_sent_to_other_processes_and_kept_in_sets(real: TendonGear) -> None:
    assert real.core is not None
    for copy in (pickle.loads(pickle.dumps(real)), deepcopy(real), real.model_copy()):
        assert copy == real
        assert hash(copy) == hash(real)
        assert [planar.axes for planar in copy.planar] == [("yaw",), ("pitch",)]
        assert tn.statics.output_angle(copy, 0.3, 1.0) == tn.statics.output_angle(real, 0.3, 1.0)
    changed = real.model_copy(update={"pretension": 5.0})
    assert tn.statics.tensions(changed, 0.0).agonist == 5.0


def test_values_of_joints_tendons_and_routes_are_changed_by_their_names() -> None:
    inst = tn.load("needle-driver")
    changes = {"joints.pitch.radius": 3e-3, "tendons.jaw_1_wound.pretension": "4 N", "tendons.pitch_wound.start": None}
    changed = inst.replace(**changes, **{"tendons.pitch_wound.pitch.coefficient": 0.2})
    assert [joint.name for joint in changed.tip_joints if joint.radius == 3e-3] == ["pitch"]
    assert changed.pretensions.tolist() == [20.0, 20.0, 4.0, 20.0, 20.0, 20.0]
    assert changed.tendons[0].route[0].coefficient == 0.2
    assert changed.replace(**{"tendons.pitch_wound.pitch.coefficient": None}).tendons[0] == inst.tendons[0]
    for key in ("joints.elbow.radius", "tendons.pitch_wound", "tendons.pitch_wound.yaw.radius"):
        with refused(key, 3e-3, kind=tn.InstrumentError):
            inst.replace(**{key: 3e-3})


def test_numpy_numbers_and_a_byte_order_mark_are_taken(real: TendonGear, tmp_path: Path) -> None:
    for number in (np.int64(3), np.float32(3), np.float64(3)):
        assert real.replace(pretension=number).pretension == 3
    (tmp_path / "marked.toml").write_text(TEXT, "utf-8-sig")
    assert tn.load(tmp_path / "marked.toml") == real


@pytest.mark.parametrize("text", ["31 N/mm", "31 kN/m", "31e3 N/m", "3.1e4 N·m^-1", "+31.0 N / mm", "31 N mm^-1"])
def test_units_are_read_as_people_write_them(real: TendonGear, text: str) -> None:
    assert real.replace(tendon_stiffness=text).tendon_stiffness == pytest.approx(31e3)


def test_an_axis_that_is_not_there_is_refused(scaled: Instrument) -> None:
    with refused("axis", "pitch", tn.InstrumentError):
        scaled.axis("pitch")


def test_the_schema_has_every_key() -> None:
    schema = json_schema()
    kinds = schema["$defs"]
    assert {"TendonGear", "TendonPulley", "Continuum"} <= set(kinds)
    assert "tendon_stiffness" in kinds["TendonGear"]["properties"]
    assert kinds["Continuum"]["properties"]["backbone_rigidity"]["examples"] == ["2e-4 N*m^2"]
    assert json.loads(json.dumps(schema)) == schema


@pytest.mark.parametrize("text", units._FACTORS)
def test_usual_units_have_the_factors_that_pint_has(text: str) -> None:
    unit, factor = units._FACTORS[text]
    pint = units._units()
    for number in (1.0, 0.3, 7.77e-3):
        assert number * factor == float(pint.Quantity(number, text).to(unit).magnitude)
