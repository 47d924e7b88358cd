"""Conditions under which an instrument is tested."""

from pydantic import Field

from tenodesis.toml import FileTable
from tenodesis.units import Angle, Length, Moment, PositiveForce, Rate


class Conditions(FileTable):
    """Conditions under which an instrument is tested, all optional."""

    forces: tuple[PositiveForce, ...] = Field(default=(), max_length=12, description="Tangential tip forces, N")
    cycles: int | None = Field(default=None, ge=1, strict=True, description="Cycles of flexion and extension")
    sampling_rate: Rate | None = Field(default=None, description="Samples per second")
    cable_force: PositiveForce | None = Field(default=None, description="Force on one weight cable of the load rig")
    cable_pulley_radius: Length | None = Field(default=None, description="Radius the weight cable acts at")
    external_moment: Moment | None = Field(default=None, description="Moment of the load rig on the distal joint")
    handle_angles: tuple[Angle, ...] = Field(default=(), description="Handle angles held, one per state")
    output_angles: tuple[Angle, ...] = Field(default=(), description="Output angles held, one per state")
