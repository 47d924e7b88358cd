"""Claims about catalogues: what is shipped is as its sources say, files merge in order, every bad one is refused."""

import math
import pickle
from pathlib import Path
from typing import Any

import pytest

from tenodesis.errors import DesignError
from tenodesis.instrument import TendonGear
from tenodesis.instrument import load as load_instrument
from tenodesis.instrument.text import with_units
from tenodesis.scaling import catalogue
from tenodesis.scaling.catalogue import NEEDED, Catalogue, Constraints, json_schema, load, shipped
from tenodesis.scaling.parts import KINDS, Rod

from .conftest import refused

ROOT = Path(__file__).parents[2]
PSI = 6894.757

FACTORS = {"7x7": 0.388, "7x19": 0.362}
"""K of 6x7-WSC and 6x19M-WSC, EN 12385-4 by Feyrer, Wire Ropes, Table 1.9."""

STRETCH = {
    "7x7 stainless": 1.20e-5,
    "7x19 stainless": 1.62e-5,
    "7x7 galvanized 1770": 1.07e-5,
    "7x19 galvanized 1960": 1.40e-5,
}
"""G of Loos & Company: elastic stretch in percent is W G / d², lbf and inches."""

ISO_54 = {"I": (1, 1.25, 1.5, 2, 2.5, 3), "II": (1.125, 1.375, 1.75, 2.25, 2.75)}
"""Modules from 1 to 3 mm."""

M1_ERRORS = {
    **{1: 1.0, 2: 1.2, 5: 1.6, 10: 2.0, 20: 2.5, 50: 3.0, 100: 5.0, 200: 10.0, 500: 25.0},
    **{1000: 50.0, 2000: 100.0, 5000: 250.0},
}
"""OIML R 111-1:2004, Table 1: maximum permissible error, mg, by nominal mass, g."""


@pytest.fixture
def write(tmp_path: Path) -> Any:
    def written(text: str, name: str = "own.toml") -> Path:
        file = tmp_path / name
        file.write_text(text, "utf-8")
        return file

    return written


def parts_of(held: Catalogue) -> list[tuple[str, Any]]:
    return [(kind, part) for kind in KINDS for part in getattr(held, kind)]


# ---- shipped data


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_part_and_constraint_tells_its_source(name: str) -> None:
    held = load(name)
    assert held.description
    for kind, part in parts_of(held):
        assert part.source, f"{kind} {part.key}"
    for table, values in (("constraints", held.constraints), ("gears", held.gears)):
        for key in values.model_fields_set if values else ():
            assert f"{table}.{key}" in held.sources


def test_the_standard_catalogue_has_what_every_joint_type_needs() -> None:
    standard = load()
    assert standard == load("standard")
    for joint_type in NEEDED:
        standard.refuse_incomplete(joint_type)
    assert standard.encoders
    assert standard.constraints == load("workshop").constraints


def test_shipped_modules_are_those_of_iso_54() -> None:
    first, both = load("gears").gears, load("gears-with-series-ii").gears
    assert first and both
    of_first = [module * 1e3 for module in first.modules if module > 0.99e-3]
    of_both = [module * 1e3 for module in both.modules if module > 0.99e-3]
    assert of_first == pytest.approx(ISO_54["I"], rel=1e-12)
    assert sorted(of_both) == pytest.approx(sorted(ISO_54["I"] + ISO_54["II"]), rel=1e-12)
    assert set(first.modules) < set(both.modules)
    assert first.teeth == both.teeth == (12, 60)


def test_every_rope_breaks_where_en_12385_4_says() -> None:
    ropes = [*load("ropes").ropes, *load("paper", "paper-ropes").ropes]
    for rope in ropes:
        factor = FACTORS[rope.name.split()[0]] if rope.name[0] == "7" else FACTORS["7x7"]
        grade = next((grade for grade in (1770, 1960) if str(grade) in rope.name), 1570)
        kilonewtons = factor * (rope.diameter * 1e3) ** 2 * grade / 1000
        assert rope.breaking_load == pytest.approx(kilonewtons * 1e3, rel=1e-12)


def test_ropes_are_as_stiff_as_their_measured_stretch() -> None:
    for rope in load("ropes").ropes:
        stretch = next(factor for name, factor in STRETCH.items() if rope.name.startswith(name))
        assert rope.modulus == pytest.approx(400 / (math.pi * stretch) * PSI, rel=1e-3)


def test_shipped_weights_are_a_one_two_two_five_set_of_class_m1() -> None:
    weights = load("weights").weights
    grams = [round(weight.mass * 1e3, 9) for weight in weights]
    assert grams == [digit * 10**decade for decade in range(4) for digit in (1, 2, 5)]
    for gram, weight in zip(grams, weights, strict=True):
        assert weight.count == (2 if str(gram)[0] == "2" else 1)
        assert weight.tolerance == pytest.approx(M1_ERRORS[int(gram)] * 1e-6, rel=1e-12)


@pytest.mark.parametrize(("name", "kind", "series"), [("pulleys", "pulleys", 20), ("spools", "spools", 10)])
def test_pulleys_and_spools_have_preferred_radii_of_iso_3(name: str, kind: str, series: int) -> None:
    for part in getattr(load(name), kind):
        steps = math.log10(part.radius * 1e3) * series
        exact = 10 ** (round(steps) / series)
        assert part.radius * 1e3 == pytest.approx(exact, rel=0.013)


def test_a_load_cell_of_class_c3_resolves_a_three_thousandth() -> None:
    cells = [cell for cell in load("load-cells").load_cells if "C3" in cell.name]
    assert [cell.range for cell in cells] == [100, 200, 500, 1000]
    for cell in cells:
        assert cell.resolution == pytest.approx(cell.range / 3000, rel=2e-3)
    assert {20, 50} < {cell.range for cell in load("load-cells").load_cells}


def test_a_rod_has_the_rigidity_of_a_round_section() -> None:
    rod = Rod(name="wire", diameter=1e-3, modulus=200e9)
    assert rod.rigidity == pytest.approx(200e9 * math.pi * (1e-3) ** 4 / 64, rel=1e-14)
    steel = [rod for rod in load("rods").rods if rod.name.startswith("spring steel")]
    assert {rod.modulus for rod in steel} == {206e9}


# ---- the paper's catalogue


def test_the_papers_choices_of_table_i_are_in_its_catalogue() -> None:
    paper, real, prototype = load("paper"), load_instrument("real-size"), load_instrument("scaled-up")
    paper.refuse_incomplete("tendon-gear")
    (rope,) = paper.ropes
    assert (rope.diameter, rope.modulus) == (prototype.tendon_diameter, prototype.tendon_modulus)
    assert paper.gears
    least, most = paper.gears.teeth
    radii = {module * teeth / 2 for module in paper.gears.modules for teeth in range(least, most + 1)}
    found = {}
    for key in ("distal_gear_radius", "proximal_gear_radius"):
        wanted = getattr(prototype, key)
        found[key] = min(radii, key=lambda radius: abs(radius - wanted))
        assert found[key] == pytest.approx(wanted, rel=1e-12)
    limits = paper.constraints
    for key in ("overall_length", "end_effector_length", "handle_length"):
        shortest, longest = getattr(limits, key)
        assert shortest <= getattr(prototype, key) <= longest
    assert limits.overall_length
    assert limits.overall_length[1] == 1.0
    assert limits.factor
    assert limits.factor[0] == 3
    assert isinstance(real, TendonGear)
    assert 3 <= found["distal_gear_radius"] / real.distal_gear_radius <= limits.factor[1]


def test_the_papers_encoder_fits_from_threefold_on() -> None:
    (encoder,) = load("paper").encoders
    real = load_instrument("real-size")
    assert isinstance(real, TendonGear)
    assert encoder.least_distal_radius == pytest.approx(3 * real.distal_gear_radius, rel=1e-12)
    assert encoder.range == pytest.approx(2 * math.pi)


def test_the_papers_test_forces_are_those_of_fig_14_over_table_iis_factor() -> None:
    limits = load("paper").constraints
    assert [force * 2.88 for force in limits.test_forces] == pytest.approx([0.5, 1.0, 1.5], rel=1e-3)
    assert limits.largest_force == limits.test_forces[-1]
    assert limits.cable_pulley_radius == 0.015


def test_both_ropes_of_table_i_are_at_hand_where_asked_for() -> None:
    diameters = [rope.diameter for rope in load("paper", "paper-ropes").ropes]
    assert diameters == [load_instrument(name).tendon_diameter for name in ("scaled-up", "real-size")]


# ---- merging


def test_parts_are_joined_and_the_last_of_a_name_wins_in_its_place(write: Any) -> None:
    own = write(
        '[[load_cells]]\nname = "class C3 100 N"\nrange = "101 N"\nresolution = "0.1 N"\n'
        '[[load_cells]]\nname = "mine"\nrange = "30 N"\nresolution = "0.1 N"\n'
        '[[weights]]\nmass = "0.5 kg"\ncount = 7\n'
    )
    before, after = load(), load("standard", own)
    assert after.name == "standard + own"
    assert [cell.name for cell in after.load_cells] == [*(cell.name for cell in before.load_cells), "mine"]
    assert {cell.name: cell.range for cell in after.load_cells}["class C3 100 N"] == 101
    assert [weight.count for weight in after.weights if weight.mass == 0.5] == [7]
    assert len(after.weights) == len(before.weights)
    assert load("standard", own, own) == after.model_copy(update={"name": "standard + own + own"})


def test_constraints_and_gears_of_a_later_file_win_key_by_key(write: Any) -> None:
    default = Constraints().tension_margin
    own = write(f"[constraints]\nfactor = [4, 5]\ntension_margin = {default}\n[gears]\nteeth = [20, 30]\n")
    base = write("[constraints]\ntension_margin = 5\nload_cell_margin = 2\n", "base.toml")
    merged = load("standard", base, own)
    assert merged.constraints.factor == (4, 5)
    assert merged.constraints.tension_margin == default, "also where it is the default"
    assert merged.constraints.load_cell_margin == 2
    assert merged.constraints.overall_length == load("standard").constraints.overall_length is not None
    assert merged.gears
    assert merged.gears.teeth == (20, 30)
    assert merged.gears.modules == load("gears").gears.modules  # type: ignore[union-attr]
    assert load(own, base).constraints.tension_margin == 5


def test_a_file_includes_others_relative_to_itself_and_goes_before_them(write: Any, tmp_path: Path) -> None:
    write("[constraints]\nfactor = [3, 4]\ntension_margin = 9\n", "base.toml")
    own = write('include = ["spools", "base.toml"]\nname = "mine"\n[constraints]\nfactor = [5, 6]\n')
    merged = load(own)
    assert (merged.name, merged.constraints.factor, merged.constraints.tension_margin) == ("mine", (5, 6), 9)
    assert merged.spools == load("spools").spools
    write('include = ["own.toml"]', "base.toml")
    with refused("include", kind=DesignError, allowed="another catalogue"):
        load(own)


def test_a_series_is_the_same_as_its_parts_one_by_one(write: Any) -> None:
    series = write(
        '[[pulleys]]\nradii = ["5 mm", "0.6 cm"]\n[[spools]]\nradii = ["5 mm"]\n'
        '[[weights]]\nmasses = ["100 g", "1 kg"]\ncounts = [2, 1]\n'
        '[[rods]]\nname = "steel"\ndiameters = ["1 mm"]\nmodulus = "206 GPa"\n'
        '[[ropes]]\nname = "7x7"\ndiameters = ["1 mm"]\nbreaking_load_factor = 0.388\nrope_grade = "1770 N/mm^2"\n'
        'modulus = "80 GPa"\n'
    )
    singly = write(
        '[[pulleys]]\nradius = "5 mm"\n[[pulleys]]\nradius = "6 mm"\n[[spools]]\nradius = "5 mm"\n'
        '[[weights]]\nmass = "100 g"\ncount = 2\n[[weights]]\nmass = "1 kg"\n'
        '[[rods]]\nname = "steel 1 mm"\ndiameter = "1 mm"\nmodulus = "206 GPa"\n'
        '[[ropes]]\nname = "7x7 1 mm"\ndiameter = "1 mm"\nmodulus = "80 GPa"\nbreaking_load = "0.68676 kN"\n',
        "singly.toml",
    )
    together, apart = load(series), load(singly)
    for (_, one), (_, other) in zip(parts_of(together), parts_of(apart), strict=True):
        for key, value in one.model_dump().items():
            expected = getattr(other, key)
            assert value == (pytest.approx(expected, rel=1e-12) if isinstance(expected, float) else expected)


def test_a_catalogue_can_be_written_with_units_and_sent_elsewhere() -> None:
    paper = load("paper")
    written = with_units(paper)
    assert written["constraints"]["overall_length"] == ["0.5 m", "1.0 m"]
    assert written["ropes"][0]["modulus"] == "50000000000.0 Pa"
    assert pickle.loads(pickle.dumps(paper)) == paper


def test_the_schema_knows_every_key() -> None:
    schema = json_schema()
    assert {*KINDS, "gears", "constraints", "include", "sources"} < set(schema["properties"])
    assert {"RopeSeries", "WeightSeries", "Constraints", "Gears"} < set(schema["$defs"])
    assert schema["$defs"]["Rope"]["properties"]["diameter"]["type"] == "string"
    assert schema["additionalProperties"] is False


# ---- refusals

ROPE = '[[ropes]]\nname = "thin"\n'
SERIES = ROPE + 'breaking_load_factor = 0.388\nrope_grade = "1770 MPa"\nmodulus = "80 GPa"\n'
CELL = '[[load_cells]]\nname = "cell"\nrange = "1 N"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a =", "not valid TOML"),
        ("rope = 1", "rope is not a known key (did you mean ropes?); it must be one of name,"),
        (
            ROPE + 'colour = "red"',
            "ropes 1 (thin): colour is not a known key; it must be one of source, known, name, diameter",
        ),
        (ROPE, "ropes 1 (thin): diameter is missing; it is required."),
        (ROPE + "diameter = 0.5", "ropes 1 (thin): diameter = 0.5: it has no unit"),
        (SERIES + 'diameters = ["1 mm", 2]', "ropes 1 (thin): diameters (value 2) = 2: it has no unit"),
        (SERIES + 'diameters = ["1 mm", "1.0 mm"]', "ropes has 'thin 1 mm' twice; it must have every part once."),
        (
            SERIES.replace("0.388", "1.2") + 'diameters = ["1 mm"]',
            "breaking_load_factor = 1.2: it must be less than 1.",
        ),
        ("[constraints]\nfactor = [8, 3]", "constraints.factor = [8, 3]: its least, 8, is more than its most, 3"),
        ('[gears]\nmodules = ["1 mm", "1.0 mm"]', "gears: modules has 1 mm twice; it must have every module once."),
        (CELL + 'resolution = "2 N"', "load_cells 1 (cell): resolution is 2 N, which is not below the range of 1 N"),
        ('[[weights]]\nmass = "1 g"\n[[weights]]\nmass = "0.001 kg"', "weights has '1 g' twice"),
        (
            '[[weights]]\nmasses = ["1 g"]\ncounts = [1, 2]',
            "counts and masses have 2 and 1 values; both must have the same number",
        ),
        (
            '[[spools]]\nradius = "1 mm"\nradii = ["2 mm"]',
            "spools 1: radius is not a known key (did you mean radii?); it must be one of source, known, radii",
        ),
        ('[ropes]\nname = "thin"', "ropes = {'name': 'thin'}: it must be a list of tables, [[ropes]]."),
        ("pulleys = [3]", "pulleys 1 = 3: it must be a table, [[pulleys]]."),
        ('[sources]\nropes_ = "x"', "sources.ropes_ names no key (did you mean ropes?); keys are gears,"),
        (
            'include = ["nowhere"]',
            "nowhere (included by own.toml): there is no such file and no catalogue of that name",
        ),
    ],
)
def test_a_bad_catalogue_is_refused_in_one_sentence(write: Any, text: str, message: str) -> None:
    with pytest.raises(DesignError) as refused:
        load(write(text))
    assert message in str(refused.value)
    assert "own.toml" in str(refused.value)
    assert str(refused.value).endswith(".")


def test_a_file_that_is_not_there_or_no_text_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(DesignError, match=r"nowhere: there is no such file .* one of encoders, gears, .*standard"):
        load("nowhere")
    with pytest.raises(DesignError, match="there is no such file"):
        load(tmp_path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DesignError, match="is not UTF-8 text"):
        load(binary)
    with pytest.raises(DesignError, match="is no path"):
        load("a\0b")


@pytest.mark.parametrize("joint_type", NEEDED)
def test_what_is_needed_and_empty_is_named(joint_type: str) -> None:
    standard = load()
    for kind in NEEDED[joint_type]:
        lacking = standard.model_copy(update={kind: None if kind == "gears" else ()})
        with pytest.raises(
            DesignError, match=f"^catalogue standard has no {kind.replace('_', ' ')}, which a {joint_type}"
        ):
            lacking.refuse_incomplete(joint_type)
    for kind in {"gears", *KINDS} - set(NEEDED[joint_type]):
        standard.model_copy(update={kind: None if kind == "gears" else ()}).refuse_incomplete(joint_type)


def test_an_empty_catalogue_and_gears_without_modules_are_refused(write: Any) -> None:
    with refused("gears", kind=DesignError, allowed="in the catalogue"):
        load(write("")).refuse_incomplete("tendon-gear")
    with refused("gears", kind=DesignError, allowed="in the catalogue"):
        load("standard", write("[gears]\nmodules = []")).refuse_incomplete("tendon-gear")
    with refused("joint_type", "hinge", kind=DesignError):
        catalogue.load().refuse_incomplete("hinge")
