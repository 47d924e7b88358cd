"""What a scale model must keep to."""

from typing import Annotated

from pydantic import AfterValidator, Field

from tenodesis.files import FileTable
from tenodesis.scaling.parts import ordered
from tenodesis.units import Length, Mass, Moment, PositiveForce, SimilarityError

_Scale = Annotated[float, Field(gt=0, le=1000, strict=True)]
_Margin = Annotated[float, Field(ge=1, le=1000, strict=True)]
_Tolerance = Annotated[float, Field(ge=0, lt=1, strict=True)]
_Lengths = Annotated[tuple[Length, Length], AfterValidator(ordered)]


class Constraints(FileTable):
    """Constraints of a design; None leaves a value free, pairs are least and most."""

    factor: Annotated[tuple[_Scale, _Scale], AfterValidator(ordered)] | None = Field(
        default=None, description="Scaled-up over real-size distal radius, least and most"
    )
    ratio_tolerance: _Tolerance = Field(
        default=0.01, description="Share by which the ratio of proximal to distal radius may differ from the real one"
    )
    overall_length: _Lengths | None = Field(default=None, description="Overall length, least and most")
    end_effector_length: _Lengths | None = Field(default=None, description="End-effector length, least and most")
    handle_length: _Lengths | None = Field(default=None, description="Handle length, least and most")
    print_bed: tuple[Length, Length] | None = Field(
        default=None, description="What the largest wheel must lie on: width and depth"
    )
    spool_torque: Moment | None = Field(
        default=None, description="Largest torque that the drive of a spool is to hold a tendon with"
    )
    similarity_error: SimilarityError | None = Field(
        default=None, description="Largest difference in output angle that is still a scale model"
    )
    tension_margin: _Margin = Field(default=1.5, description="Least breaking load over the largest tension")
    load_cell_margin: _Margin = Field(default=1.2, description="Least range of a load cell over the largest tension")
    largest_force: PositiveForce | None = Field(
        default=None, description="Force on the real-size tip to test up to; without it the largest of its conditions"
    )
    test_forces: tuple[PositiveForce, ...] = Field(
        default=(), max_length=12, description="Forces on the real-size tip to test at; without them its conditions'"
    )
    cable_pulley_radius: Length = Field(default=15e-3, description="Radius the weight cables act at")
    cable_mass: Mass = Field(default=0.05, description="Least mass on each weight cable, which keeps it taut")
    force_tolerance: _Tolerance = Field(default=0.02, description="Share by which a hung force may be off")
