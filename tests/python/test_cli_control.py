"""Claims about exported parameters: a header says what the controller computes with, and a mistake is one sentence."""

import re
from pathlib import Path

import numpy as np
import pytest

from tenodesis import _core, control
from tenodesis.control.parameters import AXIS, COMMON
from tenodesis.instrument import Instrument

from .conftest import EXAMPLES, Command


def numbers_of(text: str) -> dict[str, list[float]]:
    """Return the numbers of a header by name, in order, one per axis; limits by fault."""
    found: dict[str, list[float]] = {}
    for name, value in re.findall(r"\.(\w+) = TENODESIS_C\(([^)]+)\),", text):
        found.setdefault(name, []).append(float(value))
    for threshold, persistence, name in re.findall(
        r"\{TENODESIS_C\(([^)]+)\), TENODESIS_C\(([^)]+)\)\}, /\* (?:(\w+): )?", text
    ):
        found.setdefault(name or "spool_jump", []).extend((float(threshold), float(persistence)))
    return found


def test_a_header_holds_every_number_to_its_last_bit(any_inst: Instrument) -> None:
    parameters = control.parameters(any_inst)
    found = numbers_of(control.header(any_inst))
    for name in COMMON:
        assert found[name][0] == parameters.common[name]
    for n in range(len(any_inst.axes)):
        for name in AXIS:
            # The tension limit has the same name among the numbers that all axes share, which come first.
            value = found[name][n + (name in COMMON)]
            assert value == parameters.axes[n][name]
            assert np.float32(value) == np.float32(parameters.axes[n][name])
        for name, limit in parameters.limits[n].items():
            assert tuple(found[name][2 * n + (name in AXIS) * n :][:2]) == limit or name == "load_cell_range"


def test_a_header_names_unit_and_meaning_of_each_parameter(scaled: Instrument) -> None:
    text = control.header(scaled)
    for rows in (_core.control_parameters(), _core.control_axis_parameters()):
        for name, unit, meaning in rows:
            assert re.search(rf"^ *\.{name} = .*, /\* {re.escape(f'{unit}: {meaning}')} \*/$", text, re.MULTILINE), name
    for name, unit, _ in _core.faults():
        assert f"/* {name}: {unit}, s */" in text


@pytest.mark.parametrize("options", ["scaled-up --homed --own-clock", "needle-driver"])
def test_the_examples_have_the_headers_that_are_exported_today(
    options: str, tenodesis: Command, tmp_path: Path
) -> None:
    file = f"{options.split(maxsplit=1)[0].replace('-', '_')}.h"
    assert tenodesis("export", "controller", *options.split(), "--out", file)[0] == 0
    command = f"tenodesis export controller {options} --overwrite --out examples/{file}"
    exported, kept = ((folder / file).read_text() for folder in (tmp_path, EXAMPLES))
    number = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
    assert number.sub("#", exported) == number.sub("#", kept), f"run: {command}"
    # Linear algebra rounds the last digit otherwise on another processor.
    values, kept_values = (np.array(number.findall(text), float) for text in (exported, kept))
    np.testing.assert_allclose(values, kept_values, rtol=1e-12, err_msg=f"run: {command}")


def test_joints_whose_tendons_turn_several_have_a_controller_of_all(tenodesis: Command, tmp_path: Path) -> None:
    code, out, _ = tenodesis("export", "controller", "needle-driver", "--law", "off", "--name", "mine")
    said = "mine.h: mine, the controller of needle-driver (pitch, jaw_1, jaw_2), for tenodesis_joints_init.\n"
    assert (code, out) == (0, said)
    text = (tmp_path / "mine.h").read_text()
    assert ".compensates = 0," in text and "Written by tenodesis" in text
    for name, unit, meaning in _core.joint_control_parameters():
        assert re.search(rf"^ *\.{name} = .*, /\* {re.escape(f'{unit}: {meaning}')} \*/$", text, re.MULTILINE), name
    assert tenodesis("export", "controller", "real-size", "--law", "joints")[0] == 0
    assert "tenodesis_joints_parameters real_size = {" in (tmp_path / "real_size.h").read_text()
    code, _, problem = tenodesis("export", "controller", "needle-driver", "--observer", "paper")
    assert code == 1 and "--observer is 'paper', but the law of all joints has one of its own" in problem


def test_options_choose_what_the_controller_is(tenodesis: Command, tmp_path: Path) -> None:
    options = ("--axis", "pitch", "--observer", "exact", "--law", "paper-feedback", "--actuation", "agonist")
    more = ("--own-clock", "--name", "mine", "--out", "x.h")
    assert tenodesis("export", "controller", "real-size", *options, *more)[0] == 0
    text = (tmp_path / "x.h").read_text()
    for line in (
        "static const tenodesis_parameters mine = {",
        ".axes = 1,",
        "/* pitch */",
        ".observer = TENODESIS_OBSERVER_EXACT,",
        ".law = TENODESIS_LAW_PAPER_FEEDBACK,",
        ".actuation = TENODESIS_ACTUATION_AGONIST,",
        ".homed = 0,",
        ".own_clock = 1,",
    ):
        assert line in text


def test_a_header_serves_the_joints_that_have_a_pair_of_their_own(tenodesis: Command, tmp_path: Path) -> None:
    code, out, _ = tenodesis("export", "controller", "hybrid-scaled-up")
    assert code == 0 and "the controller of hybrid-scaled-up (yaw and pitch)" in out
    planar = control.header(control.compensated("hybrid-scaled-up"), source="hybrid-scaled-up")
    assert next(tmp_path.glob("*.h")).read_text() == planar


def test_no_name_of_a_file_breaks_the_header(scaled: Instrument) -> None:
    text = control.header(scaled, source="odd */ int main;\n#error\n.toml")
    comment = text[: text.index("#ifndef")]
    assert comment.count("*/") == 1
    assert "#error" not in [line.strip() for line in comment.splitlines()]
    assert control.identifier("2 nd/Größe.x") == "instrument_2_nd_gr_e_x"
    assert control.identifier("static") == "instrument_static"
    assert control.identifier("") == "instrument"


def test_numbers_that_make_no_controller_are_not_exported(scaled: Instrument) -> None:
    stiff = scaled.replace(**{"friction.sheath_coefficient": 0.9, "friction.sheath_bend": 9.0})
    for inst in (scaled.replace(**{"control.tension_limit": 20.0}), stiff):
        with pytest.raises(ValueError, match="the parameters of scaled-up make no controller"):
            control.header(inst)
