"""Instruments whose joints share tendons, in space: description, statics, stiffness and compensation."""

from tenodesis.coupled.axes import Pair, compensated, names_of, pairs
from tenodesis.coupled.dvrk import PULLEY_RADIUS, JawAngle, dvrk_text, from_dvrk, jaw_reading
from tenodesis.coupled.plausibility import Doubt, implausible
from tenodesis.coupled.reading import CoupledLike, is_coupled, load, of_planar, parse, shipped
from tenodesis.coupled.wrench import estimated_wrench
from tenodesis.instrument import Crossing, Grip, Joint, RouteError, Tendon
from tenodesis.instrument import FullForm as CoupledInstrument
from tenodesis.kinematics import frames, jacobian, joint_positions, mjcf, tip_pose, urdf
from tenodesis.statics import Equilibrium, Loss, TipWrench, hold, load_matrix, loss, tip_wrench
from tenodesis.statics.chain import (
    Rates,
    compensation_strokes,
    coupling,
    equilibrium,
    handle_angles,
    output_angles,
    rates,
    straight_arms,
    tensions,
)

__all__ = [
    "PULLEY_RADIUS",
    "CoupledInstrument",
    "CoupledLike",
    "Crossing",
    "Doubt",
    "Equilibrium",
    "Grip",
    "JawAngle",
    "Joint",
    "Loss",
    "Pair",
    "Rates",
    "RouteError",
    "Tendon",
    "TipWrench",
    "compensated",
    "compensation_strokes",
    "coupling",
    "dvrk_text",
    "equilibrium",
    "estimated_wrench",
    "frames",
    "from_dvrk",
    "handle_angles",
    "hold",
    "implausible",
    "is_coupled",
    "jacobian",
    "jaw_reading",
    "joint_positions",
    "load",
    "load_matrix",
    "loss",
    "mjcf",
    "names_of",
    "of_planar",
    "output_angles",
    "pairs",
    "parse",
    "rates",
    "shipped",
    "straight_arms",
    "tensions",
    "tip_pose",
    "tip_wrench",
    "urdf",
]


def __dir__() -> list[str]:
    return sorted(__all__)
