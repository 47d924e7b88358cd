"""What only the whole instrument in space needs to know: lengths between its joints, and how far they go."""

import math
from itertools import pairwise
from typing import Self

from pydantic import Field, model_validator

from tenodesis.files import FileTable
from tenodesis.units import Length, PivotRange, Spacing, TurnRange


class Geometry(FileTable):
    """Lengths along the instrument and limits of its joints; what is left out follows from the rest."""

    stem_length: Length | None = Field(
        default=None, description="Between the joints' ends nearest to the stem; by default the rest of overall_length"
    )
    joint_spacing: Spacing | None = Field(
        default=None, description="Between two distal joints, from end to end; by default a distal joint's diameter"
    )
    handle_joint_spacing: Spacing | None = Field(
        default=None, description="Between two proximal joints, from end to end; by default a proximal joint's diameter"
    )
    jaw_length: Length | None = Field(
        default=None, description="Of the jaws, for drawings; by default 0.4 of end_effector_length"
    )
    insertion: Length | None = Field(
        default=None, description="Stem beyond the port at rest; by default half of stem_length"
    )
    least_insertion: Length | None = Field(
        default=None, description="Least of the stem beyond the port; by default 0.2 of stem_length"
    )
    most_insertion: Length | None = Field(
        default=None, description="Most of the stem beyond the port; by default 0.8 of stem_length"
    )
    pivot_range: PivotRange = Field(
        default=math.radians(60), description="Largest pan and largest tilt of the stem about the port, to either side"
    )
    spin_range: TurnRange = Field(default=math.pi, description="Largest spin of the stem about itself, to either side")
    roll_range: TurnRange = Field(default=math.pi, description="Largest roll of the end-effector, to either side")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        given = [
            (key, getattr(self, key))
            for key in ("least_insertion", "insertion", "most_insertion")
            if getattr(self, key) is not None
        ]
        for (low, less), (high, more) in pairwise(given):
            if less > more:
                raise ValueError(f"{low} is {less:g} m and {high} is {more:g} m; allowed is {low} of at most {high}")
        return self
