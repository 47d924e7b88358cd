"""What controller and twin know of an instrument alike: its parameters in the core's order, links and time steps."""

from tenodesis.plant.axis import (
    core_spec,
    current_parameters,
    hand_parameters,
    hardware_parameters,
    parameter_row,
    parameters,
    spec,
)
from tenodesis.plant.links import link_rows, mass_matrix, natural_frequencies
from tenodesis.plant.routes import TwinRows, handle_share, twin_rows, twin_values
from tenodesis.plant.time_steps import (
    LARGEST_PHASE_STEP,
    TIME_STEP,
    check_runnable,
    least_tip_inertia,
    longest_step,
    natural_frequency,
    steps_per_period,
    steps_per_sample,
)

__all__ = [
    "LARGEST_PHASE_STEP",
    "TIME_STEP",
    "TwinRows",
    "check_runnable",
    "core_spec",
    "current_parameters",
    "hand_parameters",
    "handle_share",
    "hardware_parameters",
    "least_tip_inertia",
    "link_rows",
    "longest_step",
    "mass_matrix",
    "natural_frequencies",
    "natural_frequency",
    "parameter_row",
    "parameters",
    "spec",
    "steps_per_period",
    "steps_per_sample",
    "twin_rows",
    "twin_values",
]
