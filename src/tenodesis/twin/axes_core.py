"""Axes that do not act on each other, side by side."""

from collections.abc import Mapping

from tenodesis import _core, plant
from tenodesis.errors import ArgumentError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array, Names
from tenodesis.twin.commands import Frame
from tenodesis.twin.core import TwinCore
from tenodesis.twin.rows import check_handle_range, check_rig

_NEXT_AXIS = 0x9E3779B97F4A7C15 << 40
"""Axes draw from distant parts of the same random sequence, whose increment is this odd number."""


def axes_twin(inst: ShortForm, time_step: float, seed: int, quasi_static: bool) -> _core.Twin:
    """Return the core's twin of a planar instrument, at rest."""
    specs = [plant.spec(planar, time_step, quasi_static) for planar in inst.planar]
    return _core.axes_twin(specs, [(seed + n * _NEXT_AXIS) % 2**64 for n in range(len(specs))])


class AxesCore(TwinCore):
    """The twins of a planar instrument's axes."""

    def __init__(self, inst: ShortForm, time_step: float, seed: int, quasi_static: bool) -> None:
        super().__init__(
            axes_twin(inst, time_step, seed, quasi_static),
            Names.paired(inst.axes),
            {axis: (n, 2 * n, 2 * n + 1) for n, axis in enumerate(inst.axes)},
            plant.steps_per_sample(inst, time_step, quasi_static),
            ("grip_force",),
        )
        self.inst = inst
        self.kind = f"{inst.joint_type} joints of {inst.name}, {len(inst.axes)} axes"
        self.widths: Mapping[str, int] = {name: width for name, width in self.core.commands if name != "contact"}
        self.spool_radius = inst.drives.spool_radius
        ratio = inst.mismatch.pretension_ratio / inst.mismatch.stiffness_ratio
        self.stretch = ratio * max(axis.pretension / axis.tendon_stiffness for axis in inst.planar)

    def check(self, commands: Mapping[str, Array]) -> None:
        """Raise ArgumentError for a handle angle beyond the handle's range, or a weight without a rig."""
        if commands["weight"].any():
            check_rig(self.inst)
        for axis, planar, angles in zip(self.axes, self.inst.planar, commands["handle_angle"].T, strict=True):
            if not planar.dynamics.hand_stiffness:
                check_handle_range(planar, angles, axis if len(self.axes) > 1 else "")

    def check_axes(self, commands: Mapping[str, Array], axes: Frame) -> None:
        """Raise ArgumentError for axes of a wrench, which a planar instrument does not take."""
        if axes != "tip":
            raise ArgumentError(key="axes", value=axes, allowed="tip, with the forces of a planar instrument")
