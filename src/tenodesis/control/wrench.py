"""The wrench at the tip, by what a controller estimates."""

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.control.pairs import compensated, pairs
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike, expanded
from tenodesis.run import Run
from tenodesis.statics import TipWrench, flexural_stiffness, loss_of_dexterity, tip_wrench
from tenodesis.statics.wrench import USUAL


def estimated_wrench(inst: InstrumentLike, run: Run, *, usual: ArrayLike = USUAL) -> TipWrench:
    """Return the wrench at the tip by what the controller of a run estimated, at every step.

    Arguments otherwise as :func:`tip_wrench`; raises ArgumentError if there was no controller.
    """
    inst = expanded(inst)
    if run.estimated_output_angle is None:
        raise ArgumentError("the run has no estimates; it must be one with a controller.", key="run")
    planar = compensated(inst)
    shape = (len(run), len(inst.tip_joints))
    angles, moments, deviations = np.zeros(shape), np.full(shape, np.nan), np.full(shape, np.nan)
    for n, (axis, pair) in enumerate(pairs(inst).items()):
        own = planar.axis(axis)
        angle = run.by_column("estimated_output_angle")[:, n]
        # The controller's force is tangential at the end of a planar axis, positive against flexion: eq. 17's moment.
        arm = loss_of_dexterity(own, angle, 1.0) * flexural_stiffness(own, angle)
        angles[:, pair.joint] = angle
        moments[:, pair.joint] = -arm * run.by_column("estimated_force")[:, n]
        deviations[:, pair.joint] = arm * run.by_column("estimated_force_std")[:, n]
    return tip_wrench(inst, angles, moments, deviations, usual=usual)
