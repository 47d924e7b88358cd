"""Joints that share tendons, or any chain."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from tenodesis import _core
from tenodesis._core import Status
from tenodesis.control.joints import JointController
from tenodesis.control.pairs import compensated, names_of, pairs
from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm
from tenodesis.plant import twin_rows
from tenodesis.run import ACROSS, COMPONENTS, Array
from tenodesis.twin.commands import Frame
from tenodesis.twin.core import Stepped, Surroundings, Ticks, TwinCore
from tenodesis.twin.rows import check_rig

_NOT_TAKEN = ("in_stem_axes", "held", "contact")
"""Columns of a command that no argument fills."""


class ChainCore(TwinCore):
    """The twin of an instrument whose joints may share tendons."""

    def __init__(self, inst: FullForm, time_step: float, seed: int, quasi_static: bool) -> None:
        rows = twin_rows(inst, time_step, quasi_static)
        self.of_seed = partial(
            _core.chain_twin,
            inst.core,
            rows.passages,
            rows.contacts,
            rows.segments,
            rows.links,
            rows.load_cells,
            [tendon.damping for tendon in inst.tendons],
            _rig(inst),
            rows.parameters,
            rows.law,
            rows.steps_per_sample,
            quasi_static,
            inst.sensors.kind == "current",
        )
        """A twin of the same instrument and steps, by its seed"""
        own = {name: (pair.handle, pair.agonist, pair.antagonist) for name, pair in pairs(inst).items()}
        super().__init__(self.of_seed(seed), names_of(inst), own, rows.steps_per_sample)
        self.inst = inst
        self.kind = f"{len(inst.joints)} joints and {len(inst.tendons)} tendons of {inst.name}"
        self.spool_radius = inst.own_drives.spool_radius
        self.stretch = float(np.max(inst.pretensions / inst.stiffnesses))
        self.grips = inst.grip is not None
        taken = {name: width for name, width in self.core.commands if name not in _NOT_TAKEN}
        if not self.grips:
            del taken["grip_force"]
        if not self.axes:
            del taken["weight"]
        if len(self.axes) == len(inst.tip_joints):
            taken |= {"force": len(self.axes), "radial_force": len(self.axes)}
        self.widths: Mapping[str, int] = taken

    def check(self, commands: Mapping[str, Array]) -> None:
        """Raise ArgumentError for a handle angle beyond its joint's range, or a weight without a rig."""
        if "weight" in commands and commands["weight"].any():
            check_rig(self.inst)
        limits = np.array([joint.range for joint in self.inst.handle_joints])
        beyond = np.argwhere(np.abs(commands["handle_angle"]) > limits + 1e-9)
        if beyond.size and not self.inst.dynamics.hand_stiffness:
            row, column = map(int, beyond[0])
            joint = self.inst.handle_joints[column]
            raise ArgumentError(
                key=f"handle_angle[{row}] of {joint.name}",
                value=float(commands["handle_angle"][row, column]),
                allowed=f"within its range of ±{joint.range:.4g} rad",
            )

    def check_axes(self, commands: Mapping[str, Array], axes: Frame) -> None:
        """Raise ArgumentError for axes that are unknown, or forces of axes with a wrench in the stem's."""
        if axes not in ("tip", "stem"):
            raise ArgumentError(key="axes", value=axes, allowed="tip or stem")
        if axes != "tip" and any(np.any(commands.get(name, 0)) for name in ("force", "radial_force")):
            raise ArgumentError(key="axes", value=axes, allowed="tip, with the forces of axes")

    def rows(self, commands: Mapping[str, Array], constant: Surroundings) -> Array:
        """Return the commands as rows; forces of axes are added to the wrench: yaw bends toward x, pitch toward y."""
        rows = super().rows(commands, constant)
        rows[:, self.columns["in_stem_axes"]] = constant.axes == "stem"
        rows[:, self.columns["held"]] = (0.0, 0.0, 0.0) if constant.held is None else constant.held
        wrench = rows[:, self.columns["wrench"]]
        for n, axis in enumerate(self.axes if "force" in commands else ()):
            wrench[:, COMPONENTS.index(ACROSS[axis])] -= commands["force"][:, n]
            wrench[:, 2] += commands["radial_force"][:, n]
        return rows

    def run_joints(
        self, controller: JointController, rows: Array, targets: Array, requests: Sequence[int], ticks: Ticks
    ) -> tuple[Stepped, dict[str, Array]]:
        """Step over commands with observer and law of all joints; return the outcome, and their signals by step."""
        out = self._room(len(rows))
        control = np.empty((len(rows), controller.core.stored))
        steps, status = controller.core.run(
            self.core,
            rows,
            targets,
            requests,
            controller.compensates,
            self.steps_per_tick,
            ticks.time_step,
            ticks.first_step,
            out,
            control,
        )
        return Stepped(steps, Status(status), self.named(out)), controller.signals_of(control)


def _rig(inst: FullForm) -> list[float]:
    """Return the wrench on the tip by a newton on the load rig (Fig. 13), which pushes at the first joint of a pair."""
    wrench, radius = [0.0] * 6, inst.conditions.cable_pulley_radius
    if radius is not None and (axes := list(pairs(inst))):
        wrench[COMPONENTS.index(ACROSS[axes[0]])] = -radius / compensated(inst).planar[0].rig_arm
    return wrench
