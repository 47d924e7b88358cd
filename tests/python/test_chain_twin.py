"""The twin of joints and tendons: planar twin, statics, friction law and energies that it must agree with."""

import itertools
from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import _core
from tenodesis.instrument import from_dvrk
from tenodesis.plant import TwinRows, mass_matrix, natural_frequencies, twin_rows
from tenodesis.twin.rows import columns_by_name
from tests.python import chain_samples

from .chain_samples import LISTED
from .conftest import refused
from .test_import_dvrk import MATRICES, content, write

NOMINAL = {"mismatch.stiffness_ratio": 1.0, "mismatch.output_encoder_offset": 0.0}
FRICTION = {"law": "capstan", "vertex_coefficient": 0.15, "sheath_coefficient": 0.1, "sheath_bend": np.radians(20)}


def shipped(name: str, **changes: object) -> tn.instrument.FullForm:
    return tn.instrument.expanded(name).replace(**{"friction": FRICTION, **changes})


def motion(inst: tn.instrument.FullForm, steps: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Handle angles, wrench and spool velocities that are smooth, at rest at first."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 1, steps)[:, np.newaxis]

    def waves(count: int) -> np.ndarray:
        return np.sin(2 * np.pi * (rng.uniform(0.5, 2, count) * time + rng.uniform(0, 1, count))) * np.minimum(
            8 * time, 1
        )

    handles = [joint.range for joint in inst.handle_joints]
    wrench = waves(6) * np.array([0.2, 0.2, 0.1, 2e-3, 2e-3, 1e-3])
    return 0.5 * np.array(handles) * waves(len(handles)), wrench, 0.1 * waves(len(inst.tendons))


COEFFICIENTS = {"vertex_coefficient": 0.15, "sheath_coefficient": 0.1, "sheath_bend": np.radians(20)}
BENDS = {"vertex_radius": 2e-3, "tendon_bending_stiffness": 1e-6}
FRICTIONS: dict[str, dict[str, object]] = {
    "capstan": FRICTION,
    "constant": COEFFICIENTS | {"law": "capstan-constant", "constant": 0.3, "viscous": 2.0},
    "stribeck": COEFFICIENTS | {"law": "stribeck", "static_ratio": 1.5},
    "power": COEFFICIENTS | {"law": "capstan-power", "load_index": 0.8, "reference_tension": 10.0} | BENDS,
    "bending": FRICTION | BENDS,
    "two vertices": FRICTION | {"vertices_per_joint": 2, "base_wrap": 0.1},
    "a long sheath that bends": FRICTION | {"sheath_contacts": 12, "sheath_bend_per_handle_angle": 0.5},
}


@pytest.mark.parametrize(
    ("name", "quasi_static", "friction"),
    [(name, still, "capstan") for name in ("scaled-up", "real-size") for still in (False, True)]
    + [("scaled-up", still, friction) for still in (False, True) for friction in FRICTIONS if friction != "capstan"],
)
def test_one_joint_moves_as_the_planar_twin(name: str, quasi_static: bool, friction: str) -> None:
    planar = tn.load(name).axis("yaw").replace(**NOMINAL, friction=FRICTIONS[friction])
    steps = 1500
    time = np.arange(steps) * 5e-4
    handle = np.radians(30) * np.sin(2 * np.pi * 1.5 * time)
    force = 0.5 * np.sin(2 * np.pi * 2.1 * time)
    spools = np.zeros((steps, 2))
    spools[600:900, 0], spools[900:1200, 1] = 0.3, -0.2
    radial = 0.3 * np.sin(2 * np.pi * 1.1 * time)
    expected = tn.twin.Twin(planar, quasi_static=quasi_static).run(
        handle, force, radial_force=radial, spool_velocity=spools
    )
    wrench = np.zeros((steps, 6))
    wrench[:, 0], wrench[:, 2] = -force, radial
    chained = tn.instrument.expanded(planar)
    run = tn.twin.Twin(chained, quasi_static=quasi_static).run(handle[:, None], wrench=wrench, spool_velocity=spools)
    # In motion the planar twin ends a step's iteration where its slope neglects what is orders below inertia.
    assert np.abs(run["output_angle.yaw"] - expected.output_angle).max() < (1e-9 if quasi_static else 5e-9)
    assert np.abs(run["tension"] - expected.tension).max() < (1e-7 if quasi_static else 1e-6)
    assert np.abs(run["handle_torque.handle_yaw"] - expected.handle_torque).max() < 1e-8
    assert np.abs(run["spool_angle"] - expected.spool_angle).max() < 1e-12


def rows_of(core: _core.Twin, count: int, **columns: object) -> np.ndarray:
    """Rows of commands by the names of their columns."""
    blocks = [np.broadcast_to(columns.pop(name, 0.0), (count, width)) for name, width in core.commands]
    assert not columns
    return np.ascontiguousarray(np.concatenate(blocks, axis=1), dtype=float)


def signals_of(core: _core.Twin, commands: np.ndarray) -> dict[str, np.ndarray]:
    out = np.empty((len(commands), sum(width for _, width in core.signals)))
    assert core.run(commands, out, None) == (len(commands), _core.Status.OK)
    ends = np.cumsum([width for _, width in core.signals])
    return {name: out[:, end - width : end] for (name, width), end in zip(core.signals, ends, strict=True)}


@pytest.mark.parametrize("quasi_static", [False, True])
def test_tissue_let_out_and_a_bend_of_the_sheath_are_those_of_the_planar_twin(quasi_static: bool) -> None:
    planar = tn.load("scaled-up").replace(**NOMINAL, friction=FRICTION)
    count = 900
    time = np.arange(count)[:, np.newaxis] * 5e-4
    handle = 0.4 * np.sin(2 * np.pi * 1.5 * time)
    let_out = np.where(time > 0.3, [0.0, 1e-4], [0.0, 0.0])
    bend = 0.3 * np.sin(5 * time)
    tissue = tn.twin.Contact(0.2, 3000.0, 5.0)
    expected = tn.twin.Twin(planar, quasi_static=quasi_static).run(
        handle[:, 0], sheath_bend=bend[:, 0], let_out=let_out, contact=tissue
    )
    core = tn.twin.Twin(tn.instrument.expanded(planar), quasi_static=quasi_static).core
    commands = rows_of(core, count, handle_angle=handle, sheath_bend=bend, let_out=let_out, contact=tissue.row)
    found = signals_of(core, commands)
    assert expected.contact_force is not None and expected.contact_force.max() > 1
    assert np.abs(found["output_angle"][:, 0] - expected.output_angle).max() < 1e-9
    assert np.abs(found["tension"] - expected.tension).max() < 1e-7
    assert np.abs(found["contact_force"][:, 0] - expected.contact_force).max() < 1e-6


def test_a_weight_on_the_load_rig_is_that_of_the_planar_twin() -> None:
    planar = tn.load("scaled-up").replace(**NOMINAL, friction=FRICTION)
    handle, weight = np.full(800, 0.2), np.linspace(0, 3, 800)
    expected = tn.twin.Twin(planar).run(handle, weight=weight)
    found = tn.twin.Twin(tn.instrument.expanded(planar)).run(handle[:, np.newaxis], weight=weight)
    unloaded = tn.twin.Twin(planar).run(handle)
    assert np.degrees(unloaded["output_angle"][-1] - expected["output_angle"][-1]) > 1
    np.testing.assert_allclose(found["output_angle"].ravel(), expected["output_angle"].ravel(), rtol=0, atol=1e-9)
    for name, allowed in (("hybrid-real-size", "conditions.cable_pulley_radius"), ("needle-driver", "wrench")):
        with pytest.raises(tn.ArgumentError, match=allowed) as problem:
            tn.twin.Twin(name).run(np.zeros((2, len(tn.load(name).handle_joints))), weight=1.0)
        assert problem.value.key == "weight"


def test_a_state_is_bytes_from_which_a_twin_of_its_kind_goes_on() -> None:
    inst = shipped("needle-driver", friction={"law": "stribeck", "vertex_coefficient": 0.1, "static_ratio": 1.5})
    core = tn.twin.Twin(inst).core
    commands = rows_of(core, 100, spool_velocity=0.3)
    signals_of(core, commands)
    kept = core.state
    expected = signals_of(core, commands)
    core.state = kept
    again = signals_of(core, commands)
    assert all(np.array_equal(again[name], values) for name, values in expected.items())
    with pytest.raises(ValueError, match="another kind of twin"):
        core.state = tn.twin.Twin(shipped("needle-driver")).core.state


def test_a_loop_with_faults_and_a_relay_runs_as_on_the_planar_twin() -> None:
    planar = tn.load("scaled-up").replace(**NOMINAL, friction=FRICTION)
    count = 1200
    handle = np.full(count, 0.3)
    faults = np.zeros((1, count, len(_core.fault_injection_points())))
    modes = np.zeros(faults.shape, np.uint8)
    point = _core.fault_injection_points().index("tension.agonist")
    faults[0, 700:, point], modes[0, 700:, point] = 500.0, 2
    requests = np.zeros(count, np.uint8)
    requests[0] = int(tn.control.Request.ENABLE)
    runs = []
    for general in (False, True):
        twin = tn.twin.Twin(planar) if not general else tn.twin.Twin(tn.instrument.expanded(planar))
        loop = tn.control.Controller(planar, law="robust")
        control = np.empty((count, 1, len(_core.control_signals())))
        settings = (1, 5e-4, 0.02, 0, requests, faults, modes)
        load = {"wrench": [-0.5, 0, 0, 0, 0, 0]} if general else {"force": 0.5}
        commands = rows_of(twin.core, count, handle_angle=handle[:, np.newaxis], **load)
        out = np.empty((count, sum(width for _, width in twin.core.signals)))
        assert twin.core.run_controlled(loop.core, [(0, 0, 1)], commands, *settings, out, control)[0] == count
        runs.append(control[:, 0])
    state = _core.control_signals().index("operating_state")
    assert (runs[0][-1] == runs[1][-1])[state]
    assert len(np.unique(runs[0][:, state])) > 1
    assert np.abs(runs[0] - runs[1]).max() < 1e-5


def test_many_twins_over_threads_run_as_one_by_one() -> None:
    insts = [shipped("needle-driver", pretension=pretension) for pretension in (8.0, 9.0, 10.0)]
    commands = rows_of(tn.twin.Twin(insts[0]).core, 200, spool_velocity=0.2)
    cores = [tn.twin.Twin(inst).core for inst in insts]
    width = sum(columns for _, columns in cores[0].signals)
    out, ends = np.empty((3, width, 20)), np.zeros((3, 2), np.int64)
    everything = list(range(commands.shape[1])), list(range(width))
    _core.TwinBatch(cores).advance(commands[np.newaxis], *everything, 10, out, ends, 2, [], [], 1, 5e-4)
    assert ends.tolist() == [[200, int(_core.Status.OK)]] * 3
    alone = np.empty((200, width))
    for inst, found in zip(insts, out, strict=True):
        tn.twin.Twin(inst).core.run(commands, alone, None)
        assert np.array_equal(found.T, alone[9::10])


def test_the_bias_of_a_load_cell_is_read_and_moves_nothing() -> None:
    inst = shipped("needle-driver").replace(**{"sensors.load_cell_noise": 0.0})
    biases = {f"tendons.{one.name}.load_cell_bias": 0.1 * n for n, one in enumerate(inst.tendons)}
    handle, wrench, velocity = motion(inst, 50)
    right, off = (
        tn.twin.Twin(one).run(handle, wrench=wrench, spool_velocity=velocity) for one in (inst, inst.replace(**biases))
    )
    assert np.array_equal(right["tension"], off["tension"])
    read = off["measured_tension"] - right["measured_tension"]
    assert np.abs(read - 0.1 * np.arange(6)).max() <= inst.tension_sensors[0].resolution * (1 + 1e-9)


def test_tissue_at_a_joint_turns_that_joint_alone_and_loses_what_its_damping_takes() -> None:
    core = tn.twin.Twin(shipped("hybrid-scaled-up", friction={})).core
    tissue = np.zeros(3 * dict(core.signals)["output_angle"])
    tissue[3:6] = 0.05, 500.0, 1.0
    count = 1500
    handle = np.zeros((count, dict(core.commands)["handle_angle"]))
    handle[:, 1] = 0.3 * np.minimum(np.arange(count) / 700, 1)
    commands = rows_of(core, count, handle_angle=handle, contact=tissue)
    out, energy = np.empty((count, sum(width for _, width in core.signals))), np.zeros(len(_core.energies()))
    free = signals_of(core.copy(), rows_of(core, count, handle_angle=handle))["output_angle"][-1]
    assert core.run(commands, out, energy)[0] == count
    angles = out[-1, : len(free)]
    assert 0.05 < angles[1] < free[1] - 0.01
    named = dict(zip(_core.energies(), energy, strict=True))
    put_in = named["handle"] + named["load"] + named["spools"]
    lost = named["friction"] + named["damping"] + named["tissue"]
    assert named["tissue"] > 0
    assert named["stored_after"] - named["stored_before"] == pytest.approx(put_in - lost, abs=1e-3 * abs(put_in))


def test_a_hand_that_yields_moves_as_on_the_planar_twin() -> None:
    hand = {"dynamics.hand_stiffness": 8.0}
    planar = tn.load("scaled-up").replace(**NOMINAL, friction=FRICTION, **hand)
    handle = np.radians(20) * np.sin(np.arange(1200) * 5e-3)
    expected = tn.twin.Twin(planar).run(handle, 0.8)
    run = tn.twin.Twin(tn.instrument.expanded(planar)).run(handle[:, None], wrench=[-0.8, 0, 0, 0, 0, 0])
    assert np.abs(run["handle_angle"] - expected.handle_angle).max() < 1e-6
    assert np.abs(run["output_angle"] - expected.output_angle).max() < 1e-6
    assert np.abs(run["handle_torque"] - expected.handle_torque).max() < 1e-5


@pytest.mark.parametrize("name", LISTED)
def test_without_friction_a_still_twin_is_where_the_statics_say(name: str) -> None:
    inst = tn.instrument.expanded(name).replace(friction={})
    handle, wrench, _ = motion(inst, 60, seed=3)
    run = tn.twin.Twin(inst, quasi_static=True).run(handle, wrench=wrench)
    expected = tn.statics.chain.equilibrium(inst, handle, wrench)
    assert np.abs(run["output_angle"] - expected.angles).max() < 1e-6
    assert np.abs(run["tension"] - expected.tensions).max() < 1e-3


@pytest.mark.parametrize("name", LISTED)
@pytest.mark.parametrize("quasi_static", [False, True])
def test_energy_is_balanced_and_friction_only_takes(name: str, quasi_static: bool) -> None:
    inst = shipped(name)
    handle, wrench, spools = motion(inst, 2000)
    twin = tn.twin.Twin(inst, quasi_static=quasi_static)
    # Pretensions need not balance: at rest the twin first settles, at once.
    twin.run(handle[:100], wrench=wrench[:100], spool_velocity=spools[:100])
    energy = twin.energy(handle[100:], wrench=wrench[100:], spool_velocity=spools[100:])
    assert energy.friction > 0
    assert energy.least_friction > -1e-12
    assert energy.residual < 1e-9
    assert abs(energy.unaccounted) < 1e-3 * energy.work


def test_jaws_press_what_they_hold_and_the_energy_is_balanced() -> None:
    inst = shipped("needle-driver")
    opening_speed = np.sign(inst.tendon_arms("tip") @ inst.grip_arms)
    held = tn.twin.Held(opening=1e-3, stiffness=2e4, damping=5.0)
    with refused("held.opening", 0.001):
        tn.twin.Twin(inst).run(0, wrench=np.zeros((10, 6)), held=held)
    twin = tn.twin.Twin(inst)
    still = np.zeros((600, 6))
    opened = twin.run(0, wrench=still, spool_velocity=0.5 * opening_speed)
    assert opened["output_angle"][-1] @ inst.grip_arms > held.opening
    energy = twin.energy(0, wrench=still, spool_velocity=-0.9 * opening_speed, held=held)
    assert abs(energy.unaccounted) < 1e-3 * energy.work
    assert energy.tissue >= 0
    run = twin.run(0, wrench=still, held=held)
    pressed = held.opening - run["output_angle"][-1] @ inst.grip_arms
    assert run["grip_force"][-1] > 1
    assert held.stiffness * pressed == pytest.approx(run["grip_force"][-1], rel=1e-3)


def test_the_mass_matrix_is_that_of_two_rods_on_pins() -> None:
    """Closed form of the double pendulum (any textbook), its pins without offset."""
    lengths, masses = (0.05, 0.03), (0.02, 0.01)
    inst = chain_samples.in_a_plane(lengths)
    links = np.array(
        [[m, length / 2, m * length**2 / 3, m * length**2 / 3, 0.0] for m, length in zip(masses, lengths, strict=True)]
    )
    angles, speeds = np.array([0.3, -0.8]), np.array([2.0, -3.0])
    matrix, bias = mass_matrix(inst, links, angles, speeds)
    (a, b), (m, n) = lengths, masses
    coupling = n * a * b / 2 * np.cos(angles[1])
    tip = n * b**2 / 3
    both = m * a**2 / 3 + n * a**2 + tip + 2 * coupling
    assert matrix == pytest.approx(np.array([[both, tip + coupling], [tip + coupling, tip]]), rel=1e-12)
    pull = n * a * b / 2 * np.sin(angles[1])
    expected = [-pull * (2 * speeds[0] * speeds[1] + speeds[1] ** 2), pull * speeds[0] ** 2]
    assert bias == pytest.approx(expected, rel=1e-12)


def test_friction_is_that_of_a_search_over_all_ways_to_slide() -> None:
    """Two joints, four tendons, six contacts: of all 729 ways to stick and slide, those that hold give one answer."""
    inst = chain_samples.in_a_plane((0.03, 0.02), {"law": "capstan", "vertex_coefficient": 0.3})
    moments = np.array([0.02, 0.06, 0.1, 0.08, 0.0, -0.07, -0.05, 0.01])
    wrench = np.zeros((len(moments), 6))
    wrench[:, 4] = moments
    run = tn.twin.Twin(inst, quasi_static=True).run(np.zeros((len(moments), 0)), wrench=wrench)
    assert np.abs(run["output_angle"] - searched(inst, moments)).max() < 1e-7
    assert np.abs(np.diff(run["distal_tension"], axis=0)).min() > 0


def searched(inst: tn.instrument.FullForm, moments: np.ndarray) -> np.ndarray:
    """Angles of two pulleys of one axis under moments on the tip, by trying all ways to slide; (steps, 2), rad.

    Unknown are both angles and the slip of every contact; tensions are springs', a contact that slides has its edge.
    """
    rows = twin_rows(inst, 5e-4, quasi_static=True)
    contacts = [(m, j) for m in range(4) for j in range(1, rows.contacts[m])]  # the sheath's has no friction
    count = len(contacts)
    names = {contact: 2 + n for n, contact in enumerate(contacts)}
    springs, ends = {}, {}
    for m in range(4):
        for j in range(1, rows.contacts[m] + 1):
            # The first segment is the two on either side of the sheath's contact.
            in_series = rows.segments[m, :2] if j == 1 else rows.segments[m, j : j + 1]
            stretch = np.zeros(2 + count)
            if j > 1:
                stretch[names[m, j - 1]] += 1
                joint, arm = int(rows.passages[m, j - 1, 0]), rows.passages[m, j - 1, 4]
                stretch[joint] += arm
                ends[m, j] = joint, arm
            if (m, j) in names:
                stretch[names[m, j]] -= 1
            springs[m, j] = stretch / np.sum(1 / in_series)
    rest = inst.pretension
    ways = np.array(list(itertools.product((-1, 0, 1), repeat=count)))
    slips, found = np.zeros(count), []
    for moment in moments:
        angles = np.tile(found[-1] if found else np.zeros(2), (len(ways), 1))
        for _ in range(60):
            matrix, right = np.zeros((len(ways), 2 + count, 2 + count)), np.zeros((len(ways), 2 + count))
            right[:, :2] = -moment
            for (m, j), (joint, arm) in ends.items():
                matrix[:, joint] -= arm * springs[m, j]
                right[:, joint] += arm * rest
            ratio = np.array([ratios(rows, contacts, row) for row in angles])
            for n, (m, j) in enumerate(contacts):
                near, far = springs[m, j], springs[m, j + 1]
                sticks, to_spool = ways[:, n] == 0, ways[:, n] > 0
                on_near, on_far = np.where(to_spool, 1, ratio[:, n]), np.where(to_spool, ratio[:, n], 1)
                matrix[:, 2 + n] = on_near[:, None] * near - on_far[:, None] * far
                right[:, 2 + n] = (on_far - on_near) * rest
                matrix[sticks, 2 + n] = np.eye(2 + count)[2 + n]
                right[sticks, 2 + n] = slips[n]
            solved = np.linalg.solve(matrix, right[..., None])[..., 0]
            angles, before = solved[:, :2], angles
            if np.abs(angles - before).max() < 1e-12:
                break
        slid = solved[:, 2:] - slips
        holds = np.all(np.where(ways == 0, True, slid * ways >= -1e-12), axis=1)
        for n, (m, j) in enumerate(contacts):
            near, far = rest + solved @ springs[m, j], rest + solved @ springs[m, j + 1]
            holds &= (near > 0) & (far > 0)
            holds &= (near <= ratio[:, n] * far + 1e-9) & (far <= ratio[:, n] * near + 1e-9)
        answers = solved[holds]
        assert len(answers)
        assert np.ptp(answers, axis=0).max() < 1e-9
        slips = answers[0, 2:]
        found.append(answers[0, :2])
    return np.array(found)


def ratios(rows: TwinRows, contacts: list[tuple[int, int]], angles: np.ndarray) -> np.ndarray:
    passed = np.array([rows.passages[m, j] for m, j in contacts])
    # A pulley winds as much tendon as an angle lengthens its way, from what is on the straight joint.
    straight = passed[:, 2] + np.abs(passed[:, 5])
    return np.exp(passed[:, 1] * np.abs(straight + np.sign(passed[:, 4]) * angles[passed[:, 0].astype(int)]))


def test_the_default_masses_give_the_lowest_frequency_of_the_file() -> None:
    inst = shipped("needle-driver").replace(dynamics={"natural_frequency": 35.0})
    assert natural_frequencies(inst)[0] == pytest.approx(2 * np.pi * 35, rel=1e-9)


def test_a_seed_repeats_its_noise_and_a_lost_call_changes_nothing() -> None:
    inst = shipped("hybrid-scaled-up")
    handle, wrench, _ = motion(inst, 200)
    runs = [tn.twin.Twin(inst, seed=4).run(handle, wrench=wrench) for _ in range(2)]
    assert np.array_equal(runs[0]["measured_tension"], runs[1]["measured_tension"])
    twin = tn.twin.Twin(inst, seed=4)
    with refused("load", kind=tn.NoSolutionError):
        twin.run(handle, wrench=[1e4, 0, 0, 0, 0, 0])
    again = twin.run(handle, wrench=wrench)
    assert np.array_equal(again["measured_tension"], runs[0]["measured_tension"])
    assert again.time[0] == pytest.approx(5e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"handle_angle": np.zeros((5, 2))}, r"handle_angle has shape \(5, 2\); it must be \(5, 3\)"),
        (
            {"handle_angle": np.full((5, 3), 1.0)},
            r"handle_angle\[0\] of handle_yaw is 1.0; it must be within its range",
        ),
        ({"wrench": np.full((5, 6), np.nan)}, r"wrench\[0, 0\] is nan"),
        ({"spool_velocity": np.zeros((4, 5))}, "differ|fit|shape"),
        ({"axes": "world"}, "axes is 'world'; it must be tip or stem"),
        ({"held": tn.twin.Held(0.0, -1.0)}, r"held.stiffness is -1"),
    ],
)
def test_bad_commands_are_refused_in_a_sentence(arguments: dict[str, object], message: str) -> None:
    twin = tn.twin.Twin("hybrid-real-size")
    with pytest.raises(tn.ArgumentError, match=message):
        twin.run(**{"handle_angle": np.zeros((5, 3)), **arguments})  # type: ignore[arg-type]


def test_a_grip_without_jaws_and_a_base_wrap_of_all_joints_are_refused() -> None:
    with refused("held", allowed="nothing without a table [grip]"):
        tn.twin.Twin("two-segment-continuum").run(0, wrench=np.zeros((3, 6)), held=tn.twin.Held(1e-3, 1e3))
    with refused("friction.base_wrap", 0.1, kind=tn.InstrumentError):
        shipped("needle-driver", friction={"law": "capstan", "base_wrap": 0.1})
    with refused("time_step", 0.005):
        tn.twin.Twin("needle-driver", time_step=5e-3)


def test_rows_and_columns_are_found_by_name() -> None:
    inst = shipped("maryland-dissector")
    run = tn.twin.Twin(inst).run(0, wrench=np.zeros((50, 6)))
    assert run.columns("output_angle") == tuple(joint.name for joint in inst.tip_joints)
    assert run["tension." + inst.tendons[2].name].shape == (50,)
    assert "output_angle.pitch [rad]" in run.to_pandas().columns
    assert len(run.rows(10, 20)) == 10
    with pytest.raises(KeyError):
        run["output_angle.roll"]
    assert list(itertools.islice(run.signals(), 1)) == ["commanded_handle_angle"]


@pytest.mark.parametrize("name", ["hybrid-real-size", "hybrid-scaled-up"])
@pytest.mark.parametrize("damping", [0.0, 1.0, 30.0])
def test_jaws_that_touch_an_object_press_it_from_nothing_on(name: str, damping: float) -> None:
    inst = shipped(name)
    arms, steps = inst.grip_arms, 1200
    handle = np.zeros((steps, 3))
    handle[:, 2] = np.radians(25) * np.linspace(0, 1, steps)
    held = tn.twin.Held(opening=float(arms @ [0, 0, np.radians(-12)]), stiffness=3e3, damping=damping)
    run = tn.twin.Twin(inst).run(handle, held=held)
    pressed = held.opening - run["output_angle"] @ arms
    way = np.diff(np.maximum(pressed, 0), prepend=0)
    expected = np.where(pressed > 0, np.maximum(held.stiffness * pressed + damping * way / 5e-4, 0), 0)
    assert (pressed > 0).any() and (pressed <= 0).any()
    # An iteration in motion ends where it has corrected an angle by 1e-7 rad; the force is that before.
    corrected = 1e-7 * arms.max() * (held.stiffness + damping / 5e-4)
    np.testing.assert_allclose(run["grip_force"], expected, rtol=0, atol=corrected)


def test_jaws_whose_tendons_begin_to_slip_before_stiff_ends_find_an_equilibrium() -> None:
    """Where a tendon slips, a joint gives way a hundred times as easily as where it sticks: a case that was lost."""
    friction = FRICTION | {"vertex_coefficient": 0.13, "sheath_coefficient": 0.13}
    inst, steps = shipped("maryland-dissector", friction=friction), 7400
    time = np.arange(1, steps + 1)[:, np.newaxis] * 5e-4

    def eased(start: float, span: float) -> np.ndarray:
        share = np.clip((time - start) / span, 0, 1)
        return share**2 * (3 - 2 * share)

    target = eased(2.2, 1.0) * np.radians([-42, 39, 39])
    wrench = eased(3.4, 0.1) * np.array([-2.0104, 2.0104, 0, 0, 0, 0])
    controller = tn.control.JointController(inst, "off")
    run = tn.twin.Twin(inst, seed=1).run(np.zeros((steps, 0)), controller=controller, target=target, wrench=wrench)
    assert len(run.time) == steps


@pytest.mark.parametrize("seed", [4, 9, 13])
def test_a_tool_at_rest_does_not_ring_up_where_steps_are_longer_than_a_swing(tmp_path: Path, seed: int) -> None:
    """Beside contacts that stick, a swing of three steps grew until friction gave way, by a degree or more."""
    friction = FRICTION | {"vertex_coefficient": 0.13, "sheath_coefficient": 0.13}
    inst = from_dvrk(write(tmp_path, content(MATRICES["PROGRASP_FORCEPS_420093"]))).replace(friction=friction)
    rng = np.random.default_rng(seed)
    moving, still = 2500, 700
    time = np.arange(1, moving + still + 1)[:, np.newaxis] * 5e-4

    def eased(start: float, span: float) -> np.ndarray:
        share = np.clip((time - start) / span, 0, 1)
        return share**2 * (3 - 2 * share)

    # To a pose, under a force there, then to and fro; after that the motors rest.
    asked = eased(0, 0.6) * np.radians([-70, -48, 36, -70])
    for start in (0.8, 0.9, 1.0, 1.1):
        asked = asked + eased(start, 0.1) * rng.uniform(-np.radians(6), np.radians(6), 4)
    wound = asked @ inst.tendon_arms("tip").T / inst.drives.spool_radius
    core = tn.twin.Twin(inst, seed=1).core
    spools = np.diff(wound, axis=0, prepend=0) / 5e-4
    rows = rows_of(core, len(time), spool_velocity=spools, wrench=eased(0.65, 0.1) * [-2.2, 2.2, 0, 0, 0, 0])
    signals_of(core, rows[:moving])
    totals = np.zeros((still, len(_core.energies())))
    speed = np.empty(still)
    for k, row in enumerate(rows[moving:]):
        out = np.empty((1, sum(width for _, width in core.signals)))
        assert core.run(row[np.newaxis], out, totals[k]) == (1, _core.Status.OK)
        speed[k] = np.abs(out[:, columns_by_name(core.signals)["output_velocity"]]).max()
    # Within 50 ms it has died down.
    assert speed[100:].max() < 0.1 * speed[:20].max()
    energies = dict(zip(_core.energies(), totals.T, strict=True))
    assert energies["friction"].min() > -1e-12
    assert energies["damping"].min() > -1e-12
    lost = sum(energies[name] for name in ("friction", "damping", "tissue"))
    put_in = sum(energies[name] for name in ("handle", "spools", "load"))
    np.testing.assert_allclose(energies["stored_after"] - energies["stored_before"], put_in - lost, rtol=0, atol=1e-12)
