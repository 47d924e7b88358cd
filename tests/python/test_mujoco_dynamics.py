"""The instrument moving in time in MuJoCo against the statics: what checks must itself be right."""

import numpy as np
import pytest
from peers import chain_dynamics

import tenodesis as tn

STEP = 5e-4  # s
DAMPING_RATIO = 0.8
INERTIA = {"real-size": 8e-6, "scaled-up": 3e-4}  # of the tip, kg m^2


@pytest.mark.parametrize("name", INERTIA)
@pytest.mark.parametrize("radial", [0.0, 2.0])
@pytest.mark.parametrize("share", [0.5, -1.02])
def test_a_moved_handle_and_a_stepped_force_end_in_the_static_equilibrium(
    name: str, share: float, radial: float
) -> None:
    inst, inertia = tn.load(name).axis("yaw"), INERTIA[name]
    stiffness = float(tn.statics.flexural_stiffness(inst, 0.0))
    damping = 2 * DAMPING_RATIO * np.sqrt(stiffness * inertia)
    force = share * float(tn.statics.slack_force(inst, 0.0))
    ramp = np.clip(np.arange(200 / np.sqrt(stiffness / inertia) / STEP) / 200, 0, 1)
    handle, wrench = 0.2 * ramp - 0.15, np.zeros((ramp.size, 6))
    wrench[:, 0], wrench[:, 2] = np.where(ramp > 0.5, -force, 0.0), np.where(ramp > 0.7, radial, 0.0)
    moving = inst.replace(**{"dynamics.tip_inertia": inertia, "dynamics.tip_damping": damping}).expanded
    motion = chain_dynamics.simulate(moving, handle[:, np.newaxis], wrench, STEP, substeps=10)
    for sample in (0, -1):
        across, along = wrench[sample, [0, 2]]
        expected = tn.statics.equilibrium(inst, handle[sample], -across, radial_force=along)
        assert np.degrees(abs(motion.output_angle[sample, 0] - expected.output_angle)) < 1e-5
        assert motion.tension[sample] == pytest.approx([expected.agonist, expected.antagonist], abs=1e-5)
    assert (motion.tension[-1].min() == 0) == (abs(share) > 1)
