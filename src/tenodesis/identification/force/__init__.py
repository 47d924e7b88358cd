"""Force at the far end of a tool from its near end: torque or motor current, by the core's estimator."""

from tenodesis.identification.force.fitting import fit_force
from tenodesis.identification.force.model import Band, FarEndEstimate, ForceModel

__all__ = ["Band", "FarEndEstimate", "ForceModel", "fit_force"]
