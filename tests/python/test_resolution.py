"""Claims about what the sensors resolve at the tip: as drawn readings do, and known to everybody."""

from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.console.session import as_plain
from tenodesis.console.tab_setup import SetupTab
from tenodesis.control import TUNING, Controller, header, resolution
from tenodesis.control.resolution import sentences, shares, warnings
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.paper.context import Context
from tenodesis.paper.report import render
from tenodesis.run import Array

from .conftest import EXAMPLES, Command, refused

SAMPLES, TICKS = 4000, 60
FINE = {"sensors.encoder_bits": 24, "sensors.load_cell_bits": 24, "drives.encoder_counts": 2**24}
QUIET = {"sensors.encoder_noise": 0.0, "sensors.load_cell_noise": 0.0}
CALIBRATED = {"sensors.encoder_offset": 0.0, "sensors.load_cell_offset": 0.0, "sensors.load_cell_gain_error": 0.0}
COARSE = {"sensors.load_cell_bits": 9}


def quantised(value: Array, step: float) -> Array:
    return np.round(value / step) * step


def filtered(inst: Instrument, value: Array, noise: float, step: float, random: np.random.Generator) -> Array:
    """Return what the controller's measurement filter makes of noisy, quantised readings of standing values."""
    share = 1 / (1 + TUNING["smoothing"].value)
    smooth = quantised(value + noise * random.standard_normal(value.shape), step)
    for _ in range(TICKS):
        smooth += share * (quantised(value + noise * random.standard_normal(value.shape), step) - smooth)
    return smooth


def drawn_error(inst: Instrument, handle_angle: float) -> float:
    """Return the RMS error (rad) of the estimate by drawn readings of an instrument without friction."""
    random = np.random.default_rng(0)
    sensors, spool_radius = inst.sensors, inst.drives.spool_radius
    encoder_step = sensors.encoder_range / 2**sensors.encoder_bits
    cell_step = 2 * sensors.load_cell_range / 2**sensors.load_cell_bits
    spool_step = 2 * np.pi / inst.drives.encoder_counts / inst.drives.gear_ratio
    handle = handle_angle + random.uniform(-encoder_step, encoder_step, SAMPLES)
    spools = random.uniform(-spool_step, spool_step, (2, SAMPLES))
    # Common strokes and loads bring both tensions to any place between two steps.
    spools += random.uniform(-2, 2, SAMPLES) * cell_step / inst.tendon_stiffness / spool_radius
    by_force = tn.statics.gradient("tensions", inst, handle_angle, wrt=["force"])["force"]
    force = random.uniform(-2, 2, SAMPLES) * cell_step / (by_force.agonist - by_force.antagonist)
    wound = (spools[0] * spool_radius, spools[1] * spool_radius)
    tensions = np.array(tn.statics.tensions(inst, handle, force, wound=wound))
    gains = 1 + sensors.load_cell_gain_error * random.standard_normal(tensions.shape)
    offsets = sensors.load_cell_offset * random.standard_normal(tensions.shape)
    measured = filtered(inst, gains * tensions + offsets, sensors.load_cell_noise, cell_step, random)
    off = sensors.encoder_offset * random.standard_normal(SAMPLES)
    seen = filtered(inst, handle + off, sensors.encoder_noise, encoder_step, random)
    read = quantised(spools, spool_step) * spool_radius
    estimate = tn.statics.estimate_output_angle(inst, seen, *measured, wound=(read[0], read[1]))
    error = estimate - tn.statics.output_angle(inst, handle, force, wound=wound)
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize(
    "changes",
    [{}, QUIET | CALIBRATED, FINE | CALIBRATED, QUIET | CALIBRATED | COARSE, FINE | QUIET],
    ids=["all", "steps", "noise", "coarse cells", "calibration"],
)
def test_drawn_readings_are_off_by_what_the_sensors_resolve(any_inst: Instrument, changes: dict[str, Any]) -> None:
    inst = any_inst.planar[0].replace(**changes)
    known = resolution(inst)
    assert drawn_error(inst, 0.0) == pytest.approx(known.straight.total, rel=0.15)
    assert drawn_error(inst, tn.statics.reach(inst)) == pytest.approx(known.end.total, rel=0.15)
    assert known.worst.total >= max(known.straight.total, known.end.total)


def test_cells_tell_a_tip_force_as_well_as_drawn_tensions_do(any_inst: Instrument) -> None:
    inst = any_inst.planar[0].replace(**QUIET, **{"sensors.load_cell_bits": 24})
    handle, drawn = np.linspace(0.0, tn.statics.reach(inst), 5), []
    random = np.random.default_rng(0)
    forces = np.linspace(-0.5, 0.5, 101)
    for angle in handle:
        agonist, antagonist = tn.statics.tensions(inst, angle, forces)
        cells = np.array([agonist[50], antagonist[50]])[:, np.newaxis]
        offsets = inst.sensors.load_cell_offset * random.standard_normal((2, SAMPLES))
        gains = 1 + inst.sensors.load_cell_gain_error * random.standard_normal((2, SAMPLES))
        measured = gains * cells + offsets
        drawn.append(np.std(np.interp(measured[0] - measured[1], agonist - antagonist, forces)))
    assert resolution(inst).tip_force == pytest.approx(max(drawn), rel=0.05)


@pytest.mark.parametrize("key", ["sensors.encoder_bits", "sensors.load_cell_bits"])
def test_a_bit_more_never_resolves_less(any_inst: Instrument, key: str) -> None:
    known = [resolution(any_inst.replace(**{key: bits})) for bits in range(6, 20)]
    assert np.all(np.diff([one.worst.total for one in known]) < 0)
    assert np.all(np.diff([one.tip_force for one in known]) <= 0)


def test_a_coarser_sensor_adds_to_its_own_contribution_alone(scaled: Instrument) -> None:
    usual = resolution(scaled).worst
    changes = {
        "handle_encoder": {"sensors.encoder_bits": 10},
        "spool_encoders": {"drives.encoder_counts": 500},
        "load_cells": {"sensors.load_cell_noise": 0.1},
        "handle_offset": {"sensors.encoder_offset": 0.01},
        "cell_offsets": {"sensors.load_cell_offset": 0.5},
        "cell_gains": {"sensors.load_cell_gain_error": 0.05},
    }
    for name, change in changes.items():
        coarse = resolution(scaled.replace(**change)).worst
        assert getattr(coarse, name) > 2 * getattr(usual, name)
        assert coarse._replace(**{name: getattr(usual, name)}) == usual


def test_a_load_takes_what_statics_say(scaled: Instrument) -> None:
    handle = np.linspace(0.0, tn.statics.reach(scaled), 200)
    taken = tn.statics.output_angle(scaled, handle) - tn.statics.output_angle(scaled, handle, 1.5)
    known = resolution(scaled)
    assert (known.load, known.loss) == (1.5, pytest.approx(taken.max(), rel=1e-3))
    assert resolution(scaled.replace(**{"conditions.forces": [500.0]})).loss == np.inf


def test_one_sentence_says_what_the_sensors_resolve_and_a_load_takes(scaled: Instrument) -> None:
    (sentence,) = sentences(scaled)
    worst, loss = (np.degrees(angle) for angle in (resolution(scaled).worst.total, resolution(scaled).loss))
    assert sentence.startswith(f"The sensors resolve {worst:.2g}° and ")
    assert sentence.endswith(f"a load of 1.5 N takes {loss:.2g}°.")
    assert len(sentence) < 100
    (split,) = shares(scaled)
    assert split.startswith(
        f"Standard deviations: handle encoder {np.degrees(resolution(scaled).worst.handle_encoder):.2g}°, "
    )
    assert shares(scaled.replace(pretension=0.0)) == ()
    assert warnings(scaled) == ()
    assert sentences(scaled.replace(pretension=0.0)) == ("Without pretension the sensors resolve nothing at the tip.",)
    assert sentences(scaled.replace(**{"conditions.forces": [500.0]}))[0].endswith("is more than the tip can hold.")


def test_axes_with_values_of_their_own_have_a_sentence_each(real: Instrument) -> None:
    assert len(sentences(real)) == 1
    yaw, pitch = sentences(real.replace(overrides={"pitch": {"distal_gear_radius": 2.2e-3}}))
    assert yaw.startswith("Yaw: the sensors resolve 0.23°")
    assert pitch.startswith("Pitch: the sensors resolve 0.21°")


def test_sensors_that_resolve_less_than_a_load_takes_are_warned_of(pulley: Instrument) -> None:
    coarse = pulley.replace(**{"sensors.encoder_bits": 8, "conditions.forces": [0.1]})
    (warning,) = warnings(coarse)
    assert warning.startswith("the sensors resolve 0.93° at the tip, and a load of 0.1 N takes only 0.57°: motors ")


def test_a_force_limit_that_the_cells_do_not_resolve_is_refused_where_a_controller_is_made(real: Instrument) -> None:
    least = resolution(real).tip_force
    low = real.replace(**{"control.force_limit": 0.99 * least})
    for make in (Controller, header):
        with refused("control.force_limit", low.control.force_limit, InstrumentError) as caught:
            make(low)
        assert f"at least {least:.3g} N, which is what the load cells resolve at the tip" in str(caught.value)
    assert warnings(low) == (str(caught.value),)
    for allowed in (0.0, 1.01 * least):
        Controller(real.replace(**{"control.force_limit": allowed}))


def test_a_default_force_limit_is_warned_of_and_not_refused(scaled: Instrument) -> None:
    coarse = scaled.replace(**{"sensors.load_cell_offset": 30.0})
    Controller(coarse)
    assert any(warning.startswith("control.force_limit is 2.5 N; it must be at least") for warning in warnings(coarse))


def test_check_says_it_and_warns(tenodesis: Command, tmp_path: Path) -> None:
    assert sentences(tn.load("real-size"))[0] in tenodesis("check", "real-size")[1]
    file = tmp_path / "low.toml"
    text = (EXAMPLES / "pulley.toml").read_text()
    file.write_text(f'{text}\n[control]\nforce_limit = "5 mN"\n[sensors]\nencoder_bits = 4\n')
    code, said, _ = tenodesis("check", file)
    assert code == 0
    for warning in warnings(tn.load(file)):
        assert f"warning: {warning}" in said
    assert len(warnings(tn.load(file))) == 1


def test_the_report_of_the_bench_says_it_of_both_instruments(real: Instrument, scaled: Instrument) -> None:
    page = render(Context.of(real, scaled), [], {})
    for inst in (real, scaled):
        assert f"<b>{inst.name}</b>: {sentences(inst)[0]}" in page


def test_the_console_says_it_in_its_setup_tab(scaled: Instrument) -> None:
    session = MagicMock()
    session.link.inst = scaled.replace(**{"sensors.encoder_bits": 4, "conditions.forces": [0.1]})
    SetupTab(session)
    shown = [call.args[0] for call in session.client.gui.add_markdown.call_args_list]
    said = f"{sentences(session.link.inst)[0]} Warning: {warnings(session.link.inst)[0]}"
    assert as_plain(said) in shown
