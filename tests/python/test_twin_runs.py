"""Runs of the twin: states, pieces, axes and many at once; wrong arguments are refused."""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import InstrumentError, NoSolutionError
from tenodesis.instrument import Instrument
from tenodesis.plant import natural_frequency
from tenodesis.run import SIGNALS
from tenodesis.twin import TIME_STEP, Twin, run_many

from .conftest import refused
from .twin_motions import clock, eased, same, slack_force, smooth, with_friction


def test_a_state_set_again_repeats_the_run_bit_by_bit(any_inst: Instrument) -> None:
    twin = Twin(with_friction(any_inst, "stribeck", sheath_contacts=4), seed=5)
    twin.run(eased(0.3, 0.3), spool_velocity=[0.2, -0.1])
    kept = twin.state
    t = clock(0.3)
    command = {"handle_angle": 0.3 * np.cos(9 * t), "force": 0.4 * np.sin(8 * t)}
    first = twin.run(**command)
    twin.run(np.zeros(100))
    twin.state = kept
    assert twin.time == pytest.approx(0.3)
    again = twin.run(**command)
    same(first, again)
    np.testing.assert_array_equal(first.time, again.time)
    fresh = Twin(twin.inst, seed=99)
    fresh.state = kept
    same(first, fresh.run(**command))


def test_in_pieces_or_step_by_step_it_is_the_run_in_one(real: Instrument) -> None:
    t = clock(0.2)
    handle_angle = np.stack([0.2 * np.sin(9 * t), 0.1 * np.sin(5 * t)], -1)
    force = np.stack([0.2 * np.sin(20 * t), 0.1 * t], -1)
    velocity = np.tile([0.1, -0.1, 0.2, 0.0], (t.size, 1))
    at_once = Twin(real, seed=4).run(handle_angle, force, spool_velocity=velocity)
    pieces, steps = Twin(real, seed=4), Twin(real, seed=4)
    cut = [0, 1, 7, 130, t.size]
    parts = [
        pieces.run(handle_angle[a:b], force[a:b], spool_velocity=velocity[a:b]) for a, b in itertools.pairwise(cut)
    ]
    singles = [steps.step(handle_angle[k], force[k], spool_velocity=velocity[k]) for k in range(t.size)]
    for name, values in at_once.signals().items():
        assert values.shape[1] == (4 if SIGNALS[name].per_tendon else 2)
        np.testing.assert_array_equal(values, np.concatenate([part.signals()[name] for part in parts]))
        np.testing.assert_array_equal(values, np.stack([single.signals()[name] for single in singles]))
    assert [float(single.time) for single in singles] == pytest.approx(at_once.time)


def test_each_axis_is_a_twin_of_its_own(real: Instrument) -> None:
    t = clock(0.3)
    handle_angle = np.stack([0.2 * np.sin(9 * t), 0.15 * np.sin(5 * t)], -1)
    force = np.stack([0.3 * np.sin(20 * t), 0.2 * t], -1)
    both = Twin(real).run(handle_angle, force)
    assert both.axes == ("yaw", "pitch")
    for n, name in enumerate(both.axes):
        one = Twin(real.axis(name)).run(handle_angle[:, n], force[:, n])
        for signal, values in one.signals().items():
            if not signal.startswith("measured"):
                np.testing.assert_array_equal(both.axis(name).signals()[signal], values)
                tendon = f"{name}_antagonist"
                if SIGNALS[signal].per_tendon:
                    np.testing.assert_array_equal(both[f"{signal}.{tendon}"], values[:, 1])
                    np.testing.assert_array_equal(both[signal][:, both.tendons.index(tendon)], values[:, 1])
    noise = both.measured_handle_angle - both.handle_angle
    assert not np.array_equal(noise[:, 0], noise[:, 1])
    shared = Twin(real).run(handle_angle, force[:, 0])
    np.testing.assert_array_equal(shared.force[:, 1], force[:, 0])


@pytest.fixture
def threads() -> Iterator[None]:
    before = tn.threads.threads()
    yield
    tn.set_threads(before)


@pytest.mark.usefixtures("threads")
def test_many_runs_are_the_single_ones_whatever_the_threads(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    runs, t = 7, clock(0.2)
    vary = {
        "pretension": np.linspace(15, 30, runs),
        "friction.vertex_coefficient": np.linspace(0, 0.4, runs),
        "mismatch.stiffness_ratio": np.linspace(0.8, 1.2, runs),
    }
    handle_angle = np.linspace(0.05, 0.3, runs)[:, None] * np.sin(20 * t)
    force = 0.3 * slack_force(inst) * np.sin(9 * t)
    velocity = np.linspace(0, 1, runs)[:, None, None] * np.stack([np.sin(30 * t), np.cos(30 * t)], -1)
    signals = ("output_angle", "tension.antagonist", "measured_tension.agonist", "handle_torque")
    seeds = np.arange(runs) * 11
    batches = []
    for count in (1, 2, 3):
        tn.set_threads(count)
        batches.append(
            run_many(
                inst, handle_angle, force, spool_velocity=velocity, vary=vary, seeds=seeds, signals=signals, every=4
            )
        )
    for batch in batches:
        assert (batch.steps == t.size).all() and (batch.status == 0).all()
        np.testing.assert_allclose(batch.time, t[3::4], rtol=1e-12)
        for name in signals:
            np.testing.assert_array_equal(batch[name], batches[0][name])
    for n in range(runs):
        own = inst.replace(**{key: float(values[n]) for key, values in vary.items()})
        run = Twin(own, seed=int(seeds[n])).run(handle_angle[n], force, spool_velocity=velocity[n])
        for name in signals:
            kind, _, side = name.partition(".")
            values = run.signals()[kind]
            values = values[:, ["agonist", "antagonist"].index(side)] if side else values
            np.testing.assert_array_equal(batches[0][name][n], values[3::4])


def test_a_lost_run_is_reported_and_leaves_the_others_alone(scaled: Instrument) -> None:
    inst = smooth(scaled)
    force = np.outer([0.0, 40.0, 1.0], np.linspace(0, 1, 400))
    batch = run_many(inst, np.zeros(400), force, quasi_static=True)
    lost = int(batch.steps[1])
    assert list(batch.status != 0) == [False, True, False]
    assert 0 < lost < 400
    assert np.isfinite(batch["output_angle"][1, :lost]).all() and np.isnan(batch["output_angle"][1, lost:]).all()
    assert np.isfinite(batch["output_angle"][[0, 2]]).all()


# Bad input


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"friction.vertex_coefficient": -0.1}, r"friction\.vertex_coefficient = -0\.1: .*greater than or equal to 0"),
        ({"breaking_load": 20.0}, "pretension is 25 N, at which a tendon of 20 N breaking_load has broken"),
        ({"friction.sheath_contacts": 33}, "friction.sheath_contacts = 33: .*less than or equal to 32"),
        ({"sensors.encoder_bits": 3}, "sensors.encoder_bits = 3"),
        ({"dynamics.tip_inertia": 0.0}, "dynamics.tip_inertia = 0"),
    ],
)
def test_an_instrument_that_cannot_be_is_refused(scaled: Instrument, changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InstrumentError, match=sentence):
        scaled.replace(**changes)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("time_step", value) for value in (0.1, 3e-4, -1.0, float("nan"))),
        *(("seed", value) for value in (-1, 2**64, 1.5, True)),
    ],
)
def test_a_twin_that_cannot_be_is_refused(scaled: Instrument, key: str, value: Any) -> None:
    with refused(key, value):
        Twin(scaled, **{key: value})


def test_the_largest_time_step_is_said_and_taken(any_inst: Instrument) -> None:
    inst = smooth(any_inst)
    longest = 0.5 / natural_frequency(inst)
    with refused("time_step"):
        Twin(inst, time_step=longest * 1.001)
    run = Twin(inst, time_step=longest * 0.999).run(np.full(2000, 0.2))
    assert run.output_angle[-1] == pytest.approx(tn.statics.output_angle(inst, 0.2, 0.0), abs=1e-8)


@pytest.mark.parametrize(
    ("command", "key", "value"),
    [
        ({"handle_angle": [0, np.nan]}, "handle_angle[1]", np.nan),
        ({"handle_angle": np.nan}, "handle_angle", np.nan),
        ({"force": [0, np.inf]}, "force[1]", np.inf),
        ({"radial_force": [np.nan, 0]}, "radial_force[0]", np.nan),
        ({"weight": [0, np.nan]}, "weight[1]", np.nan),
        ({"spool_velocity": [[0, 0], [0, np.nan]]}, "spool_velocity[1, 1]", np.nan),
        ({"handle_angle": [0, 0.1, 2]}, "handle_angle[2]", 2.0),
        ({"force": [0, 0, 0]}, "force", (3,)),
        ({"handle_angle": [[0, 0, 0]]}, "handle_angle", (1, 3)),
    ],
)
def test_a_command_that_cannot_be_is_refused_and_nothing_done(
    scaled: Instrument, command: dict[str, Any], key: str, value: Any
) -> None:
    twin = Twin(scaled)
    before = twin.state
    for call in (twin.run, twin.energy):
        with refused(key, value):
            call(**({"handle_angle": [0, 0]} | command))
    assert twin.state == before


def test_a_handle_angle_beyond_range_names_its_axis(real: Instrument) -> None:
    with refused("handle_angle[1] of pitch", 1.0):
        Twin(real).run([[0, 0], [0, 1.0]])


def test_loaded_past_the_fold_at_rest_it_says_where(scaled: Instrument) -> None:
    inst = smooth(scaled)
    force = np.linspace(0, 30, 4000)
    folds = int(np.argmin(np.isfinite(tn.statics.output_angle(inst, 0.0, force))))
    twin = Twin(inst, quasi_static=True)
    with refused("load", folds, kind=NoSolutionError):
        twin.run(np.zeros(4000), force)


def test_loaded_past_the_fold_in_motion_it_snaps_to_the_stop(scaled: Instrument) -> None:
    inst = smooth(scaled).replace(**{"dynamics.output_stop": 1.8})
    force = np.minimum(np.linspace(0, 30, 4000), 12.0)
    run = Twin(inst).run(np.zeros(4000), force)
    assert np.isnan(tn.statics.output_angle(inst, [0.0], 12.0)).all()
    assert run.output_angle[-1] < -1.8


@pytest.mark.parametrize(
    ("arguments", "key", "value"),
    [
        ({"signals": ["tip"]}, "signals", "tip"),
        ({"every": 3}, "every", 3),
        ({"seeds": [1, 2]}, "seeds", (2,)),
        ({"seeds": [-1]}, "seed", -1),
        ({"seeds": [1.5]}, "seed", 1.5),
        ({"seeds": [True]}, "seed", True),
        ({"handle_angle": np.nan}, "handle_angle", np.nan),
        ({"force": [0, np.nan]}, "force[1]", np.nan),
        ({"vary": {"pretension": [1.0, 2.0], "handle_length": [0.1]}}, "vary", None),
        ({"force": np.zeros((2, 2)), "vary": {"pretension": [1.0, 2.0, 3.0]}}, "handle_angle", (2, 2)),
        ({"time_step": 0.1}, "time_step", 0.1),
    ],
)
def test_runs_that_cannot_be_are_refused(scaled: Instrument, arguments: dict[str, Any], key: str, value: Any) -> None:
    with refused(key, value):
        run_many(scaled, **({"handle_angle": [0.0, 0.0]} | arguments))


@pytest.mark.parametrize(("key", "values"), [("pretensions", [1.0, 2.0]), ("pretension", [20.0, -2.0])])
def test_a_value_that_cannot_vary_so_is_refused(scaled: Instrument, key: str, values: list[float]) -> None:
    with refused(key, kind=InstrumentError):
        run_many(scaled, [0.0, 0.0], vary={key: values})


def test_runs_of_unlike_twins_or_two_axes_are_refused(real: Instrument, scaled: Instrument) -> None:
    for insts in (real, [scaled, smooth(scaled)], []):
        with refused("inst"):
            run_many(insts, [0.0])


def test_the_energies_of_two_axes_are_those_of_each_added(real: Instrument) -> None:
    handle = np.linspace(0, 0.3, 200)[:, np.newaxis] * [1.0, -0.5]
    both = Twin(real).energy(handle, 0.5)
    each = [Twin(real.axis(name)).energy(handle[:, n], 0.5) for n, name in enumerate(real.axes)]
    for name in ("stored_after", "handle", "load", "friction", "damping"):
        assert getattr(both, name) == pytest.approx(sum(getattr(one, name) for one in each), rel=1e-9)


def test_a_state_of_another_kind_of_twin_is_refused(real: Instrument, scaled: Instrument, pulley: Instrument) -> None:
    twin = Twin(scaled)
    with refused("state", allowed="tendon-gear joints of scaled-up, 1 axes,"):
        twin.state = Twin(real).state
    for other, different in (
        (Twin(with_friction(scaled, sheath_contacts=4)), "4 sheath contacts"),
        (Twin(with_friction(scaled, "stribeck")), "stribeck friction"),
        (Twin(scaled, time_step=TIME_STEP / 2), "steps of 0.00025 s"),
        (Twin(with_friction(pulley)), "tendon-pulley joints"),
    ):
        other.run([0.1])
        assert different in other.state.kind
        with refused("state", other.state.kind):
            twin.state = other.state
    assert twin.time == 0


def test_a_handle_that_takes_all_of_the_tendon_is_refused(scaled: Instrument) -> None:
    with refused("handle_length", 1.0):
        Twin(scaled.replace(handle_length=1.0))
