"""Twins in the lanes of vectors: each is the twin that runs alone, to the last bit, whatever its neighbours do."""

from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import _core, control
from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.twin import TIME_STEP, Contact, Twin, run_many
from tenodesis.twin.axes_core import axes_twin
from tenodesis.twin.rows import columns_by_name

from .conftest import refused
from .twin_motions import clock, slack_force, with_friction

RUNS = 11
OVERLOAD = 1.5
COMMANDS = columns_by_name(_core.axis_commands())
WIDTH = sum(width for _, width in _core.axis_commands())
HANDLE, FORCE = COMMANDS["handle_angle"].start, COMMANDS["force"].start


def commands(inst: Instrument, t: Array) -> Array:
    """Return motions that differ by run: some tips are loaded until a tendon is slack, some hardly at all."""
    rows = np.zeros((RUNS, t.size, WIDTH))
    share = np.linspace(0, 1, RUNS)[:, np.newaxis]
    rows[:, :, HANDLE] = 0.25 * share * np.sin(17 * t)
    rows[:, :, FORCE] = OVERLOAD * slack_force(inst) * share[::-1] * np.sin(9 * t)
    return rows


def advanced(inst: Instrument, most_lanes: int, rows: Array, quasi_static: bool, **vary: Array) -> tuple[Array, Array]:
    insts = [inst.replace(**{key: values[n].item() for key, values in vary.items()}) for n in range(RUNS)]
    cores = [axes_twin(one, TIME_STEP, n, quasi_static) for n, one in enumerate(insts)]
    twins = _core.TwinBatch(cores, most_lanes=most_lanes)
    assert min(2, most_lanes) <= twins.together <= most_lanes
    width = sum(columns for _, columns in cores[0].signals)
    out, ends = np.full((RUNS, width, rows.shape[1]), np.nan), np.zeros((RUNS, 2), np.int64)
    twins.advance(rows, list(range(WIDTH)), list(range(width)), 1, out, ends, 1, [], [], 1, TIME_STEP)
    return out, ends


@pytest.mark.parametrize("quasi_static", [False, True], ids=["in motion", "quasi-static"])
@pytest.mark.parametrize("changes", [{}, {"dynamics.hand_stiffness": 2.0}], ids=["handle held", "a hand that yields"])
def test_as_many_lanes_as_there_are_change_no_bit(
    any_inst: Instrument, changes: dict[str, Any], quasi_static: bool
) -> None:
    inst = with_friction(any_inst).replace(**changes).planar[0]
    # Longer steps at rest, where each takes longer.
    rows = commands(inst, clock(0.3))[:, :: 6 if quasi_static else 1]
    coefficients = {"friction.vertex_coefficient": np.linspace(0, 0.5, RUNS)}
    alone, ends = advanced(inst, 1, rows, quasi_static, **coefficients)
    assert (ends[:, 1] == 0).all() or (quasi_static and (ends[:, 1] == 0).any())
    tension = alone[:, columns_by_name(axes_twin(inst, TIME_STEP, 0, quasi_static).signals)["tension"].start + 1]
    assert (tension.min(1) < 1e-9).any() and (tension.min(1) > 1.0).any()
    for lanes in (2, 4, 8):
        np.testing.assert_array_equal(advanced(inst, lanes, rows, quasi_static, **coefficients)[0], alone)


@pytest.mark.parametrize("quasi_static", [False, True], ids=["in motion", "quasi-static"])
def test_tissue_is_met_in_some_lanes_only(scaled: Instrument, quasi_static: bool) -> None:
    inst, t = with_friction(scaled), clock(0.3)
    tissue = [Contact(np.radians(4), 2000.0, 1.0) if n % 3 else None for n in range(RUNS)]
    handle = np.linspace(0, 0.4, RUNS)[:, np.newaxis] * np.sin(12 * t)
    signals = ("output_angle", "contact_force")
    batch = run_many(inst, handle, contact=tissue, signals=signals, quasi_static=quasi_static)
    assert (batch["contact_force"].max(1) > 0).sum() > 2
    for n, contact in enumerate(tissue):
        run = Twin(inst, seed=n, quasi_static=quasi_static).run(handle[n], contact=contact)
        np.testing.assert_array_equal(batch["output_angle"][n], run.output_angle)


def test_a_lane_without_equilibrium_stands_still_until_it_is_restarted(scaled: Instrument) -> None:
    inst, t = with_friction(scaled), clock(0.2)
    force = np.outer([0.0, 400.0, 1.0], t / t[-1])
    batch = run_many(inst, np.zeros(t.size), force)
    lost = int(batch.steps[1])
    assert list(batch.status) == [0, int(tn.statics.Status.NO_EQUILIBRIUM), 0]
    assert np.isfinite(batch["output_angle"][1, :lost]).all() and np.isnan(batch["output_angle"][1, lost:]).all()
    for n in (0, 2):
        run = Twin(inst, seed=n).run(np.zeros(t.size), force[n])
        np.testing.assert_array_equal(batch["output_angle"][n], run.output_angle)

    cores = [axes_twin(inst, TIME_STEP, n, False) for n in range(3)]
    twins = _core.TwinBatch(cores)
    rows = force[:, :, np.newaxis].copy()
    out, ends = np.empty((3, 1, t.size)), np.zeros((3, 2), np.int64)
    kept = [FORCE], [columns_by_name(cores[0].signals)["output_angle"].start]
    twins.advance(rows, *kept, 1, out, ends, 1, [], [], 1, TIME_STEP)
    assert list(ends[:, 1] != 0) == [False, True, False]
    rows[1] = rows[2]
    twins.advance(rows, *kept, 1, out, ends, 1, [], [], 1, TIME_STEP)
    assert list(ends[:, 0]) == [t.size, 0, t.size]
    twins.restart([1], [cores[2]])
    twins.advance(rows, *kept, 1, out, ends, 1, [], [], 1, TIME_STEP)
    np.testing.assert_array_equal(out[1, 0], batch["output_angle"][2])


def test_loops_of_two_axes_that_share_a_chain_are_those_that_run_alone() -> None:
    inst = tn.instrument.expanded(tn.load("real-size").replace(axes=("yaw", "pitch")))
    runs, t = 3, clock(0.4)
    handle = np.stack([0.3 * np.sin(9 * t), -0.2 * np.sin(5 * t)], axis=-1)
    load = np.where(t > 0.2, 1.0, 0.0)[:, np.newaxis] * [-0.5, 0.3, 0, 0, 0, 0]
    handle = np.linspace(0.5, 1, runs)[:, np.newaxis, np.newaxis] * handle
    controllers = [control.Controller(inst) for _ in range(runs)]
    names = ("output_angle", "commanded_spool_velocity", "estimated_output_angle", "tension.pitch_agonist")
    batch = run_many(inst, handle, wrench=load, signals=names, controllers=controllers, every=2)
    for n in range(runs):
        run = Twin(inst, seed=n).run(handle[n], wrench=load, controller=control.Controller(inst))
        assert run.commanded_spool_velocity.any()
        for name in names:
            np.testing.assert_array_equal(batch[name][n], run[name][1::2])


def test_loops_through_controllers_are_those_that_run_alone(scaled: Instrument) -> None:
    runs, t = 5, clock(0.6)
    vary = {"friction.vertex_coefficient": np.linspace(0.05, 0.2, runs)}
    handle, force = 0.3 * np.sin(4 * t), np.where(t > 0.2, 1.0, 0.0)
    names = ("output_angle", "measured_tension.agonist", "tension", "estimated_output_angle", "faults")
    batch = run_many(
        scaled,
        handle,
        force,
        vary=vary,
        controllers=[control.Controller(scaled) for _ in range(runs)],
        signals=names,
        every=5,
    )
    for n in range(runs):
        own = scaled.replace(**{key: values[n].item() for key, values in vary.items()})
        run = Twin(own, seed=n).run(handle, force, controller=control.Controller(scaled))
        assert run.estimated_output_angle is not None and run.commanded_spool_velocity.any()
        np.testing.assert_array_equal(batch["output_angle"][n], run.output_angle[4::5])
        np.testing.assert_array_equal(batch["measured_tension.agonist"][n], run.measured_tension[4::5, 0])
        np.testing.assert_array_equal(batch["tension"][n], run.tension[4::5])
        np.testing.assert_array_equal(batch["tension.yaw_antagonist"][n], run["tension.yaw_antagonist"][4::5])
        np.testing.assert_array_equal(batch["estimated_output_angle"][n], run.estimated_output_angle[4::5])


@pytest.mark.parametrize("quasi_static", [False, True], ids=["in motion", "quasi-static"])
def test_two_axes_that_share_a_chain_step_in_lanes_as_alone(quasi_static: bool) -> None:
    friction = {"law": "capstan", "vertex_coefficient": 0.3, "sheath_coefficient": 0.15, "sheath_bend": 1.0}
    planar = tn.load("real-size").replace(axes=("yaw", "pitch"))
    inst = tn.instrument.expanded(planar).replace(friction=friction)
    t = clock(0.2)[:: 6 if quasi_static else 1]
    share = np.linspace(0, 1, RUNS)[:, np.newaxis, np.newaxis]
    handle = share * np.stack([0.3 * np.sin(17 * t), -0.2 * np.sin(9 * t)], axis=-1)
    wrench = np.zeros((RUNS, t.size, 6))
    wrench[:, :, :2] = 0.4 * share[::-1] * np.stack([np.sin(7 * t), np.cos(5 * t) - 1], axis=-1)
    vary = {"friction.vertex_coefficient": np.linspace(0, 0.4, RUNS)}
    names = ("output_angle", "tension", "measured_tension", "handle_torque")
    batch = run_many(inst, handle, wrench=wrench, vary=vary, signals=names, quasi_static=quasi_static)
    assert (batch.status == 0).all()
    for n in range(RUNS):
        own = inst.replace(**{key: values[n].item() for key, values in vary.items()})
        run = Twin(own, seed=n, quasi_static=quasi_static).run(handle[n], wrench=wrench[n])
        for name in names:
            np.testing.assert_array_equal(batch[name][n], run[name])


@pytest.mark.parametrize(
    ("count", "given", "key"),
    [
        (2, {}, "controllers"),
        (3, {"spool_velocity": np.ones((10, 2))}, "spool_velocity"),
        (3, {"signals": ("tip",)}, "signals"),
    ],
)
def test_loops_that_cannot_be_closed_are_refused(
    scaled: Instrument, count: int, given: dict[str, Any], key: str
) -> None:
    controllers = [control.Controller(scaled) for _ in range(count)]
    with refused(key):
        run_many(scaled, np.zeros((3, 10)), controllers=controllers, **given)
