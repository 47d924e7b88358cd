"""The twin of joints and tendons in motion, and its mass matrix, against MuJoCo's own."""

from typing import Any

import numpy as np
import pytest
from peers import chain_dynamics

from tenodesis import instrument
from tenodesis.instrument import FullForm
from tenodesis.plant import link_rows, mass_matrix
from tenodesis.statics import chain
from tenodesis.twin import Twin

from .chain_samples import LISTED, backbone, jaws, two_axes

STEP = 5e-4  # s
# The peer has a row of tied hinges for a backbone, which is one arc.
SHIPPED = [pytest.param(instrument.in_arcs(name, 1).replace(friction={}), id=name) for name in LISTED]


def moved(inst: FullForm, seed: int, steps: int, size: float) -> tuple[float, bool]:
    """Follow waves of handle, motors and wrench; of the size (rad) that a joint at rest would turn by a wrench.

    Returns the largest difference of any angle from MuJoCo's, deg, and whether a tendon went slack.
    """
    random = np.random.default_rng(seed)
    time = STEP * np.arange(steps + 1)[:, np.newaxis]

    def waves(count: int) -> Any:
        return np.sin(2 * np.pi * (random.uniform(0.5, 4, count) * time + random.uniform(0, 1, count)))

    straight = np.abs(chain.rates(inst, 0.0).by_wrench)
    wrench = np.repeat([size / straight[:, :3].max(), size / straight[:, 3:].max()], 3) * waves(6)
    handle = 0.25 * np.array([joint.range for joint in inst.handle_joints]) * waves(len(inst.handle_joints))
    velocity = 0.5 * waves(len(inst.tendons))
    twin = Twin(inst, time_step=STEP)
    twin.run(np.tile(handle[:1], (3000, 1)), wrench=wrench[0])  # to rest
    run = twin.run(handle[1:], wrench=wrench[1:], spool_velocity=velocity[1:])
    assert (np.abs(run["output_angle"]).max(axis=0) < [joint.range for joint in inst.tip_joints]).all()
    radius = inst.spool_radius or inst.drives.spool_radius
    strokes = np.vstack([np.zeros((1, len(inst.tendons))), radius * run["spool_angle"]])
    theirs = chain_dynamics.simulate(inst, handle, wrench, STEP, strokes=strokes, substeps=5)
    assert run["tension"] == pytest.approx(theirs.tension[1:], abs=0.05)
    difference = np.degrees(np.abs(run["output_angle"] - theirs.output_angle[1:]).max())
    return float(difference), bool((run["tension"] == 0).any())


@pytest.mark.parametrize("inst", SHIPPED)
def test_joints_that_share_tendons_move_as_in_mujoco(inst: FullForm) -> None:
    difference, _ = moved(inst, 0, 300, 0.1)
    assert difference <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize("inst", SHIPPED)
def test_they_do_with_tendons_that_slacken(inst: FullForm) -> None:
    found = [moved(inst, seed, 2000, 0.2) for seed in (1, 2)]
    assert max(difference for difference, _ in found) <= 0.05
    assert any(slack for _, slack in found)


@pytest.mark.parametrize(
    "inst", [*SHIPPED, *(pytest.param(one, id=one.name) for one in (jaws(), backbone(), two_axes("scaled-up")))]
)
def test_the_mass_matrix_and_what_rates_take_are_mujocos(inst: FullForm) -> None:
    is_row = any(joint.mechanism == "continuum" for joint in inst.tip_joints)
    # Up to a high order of its bends a row of vertebrae reaches as far as an arc; its rates do so to a lower order.
    for_matrix, for_rates = (5e-4, 1e-2) if is_row else (1e-9, 1e-9)
    random = np.random.default_rng(1)
    for _ in range(3):
        angles = random.uniform(-1, 1, len(inst.tip_joints)) * [joint.range for joint in inst.tip_joints]
        rates = random.uniform(-5, 5, len(inst.tip_joints))
        matrix, bias = mass_matrix(inst, link_rows(inst), angles, rates)
        expected, moments = chain_dynamics.mass_matrix(inst, angles, rates)
        assert matrix == pytest.approx(expected, abs=for_matrix * np.abs(expected).max())
        assert bias == pytest.approx(moments, abs=for_rates * np.abs(moments).max())
