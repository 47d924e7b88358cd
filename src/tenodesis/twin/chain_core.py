"""Joints that share tendons, or any chain: one twin of the core for all of them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tenodesis import _core
from tenodesis._core import Status
from tenodesis.control.pairs import names_of, pairs
from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm
from tenodesis.run import Array
from tenodesis.twin.chain_rows import twin_rows
from tenodesis.twin.contact import NO_TISSUE
from tenodesis.twin.core import Constant, Outcome, Ticks
from tenodesis.twin.rows import CONTROL, columns_by_name, signals_of_commands

_UNSEEN = ("sweeps",)
_NOT_TAKEN = ("in_stem_axes", "held", "contact", "weight")
"""Columns of a command that no argument fills, or that no instrument has a rig for."""


class ChainCore:
    """The twin of an instrument whose joints may share tendons."""

    def __init__(self, inst: FullForm, time_step: float, seed: int, quasi_static: bool) -> None:
        self.inst = inst
        self.names = names_of(inst)
        self.kind = f"{len(inst.joints)} joints and {len(inst.tendons)} tendons of {inst.name}"
        own = pairs(inst)
        self.axes = tuple(own)
        self._pairs = [tuple(pair[1:]) for pair in own.values()]
        self.own_tendons: Sequence[int] = [tendon for _, *tendons in self._pairs for tendon in tendons]
        rows = twin_rows(inst, time_step, quasi_static)
        self.spool_radius = inst.own_drives.spool_radius
        self.stretch = float(np.max(inst.pretensions / inst.stiffnesses))
        self.steps_per_tick = rows.steps_per_sample
        self._core = _core.WristTwin(
            inst.core,
            rows.passages,
            rows.contacts,
            rows.segments,
            rows.links,
            rows.load_cells,
            rows.rig,
            rows.parameters,
            rows.law,
            rows.steps_per_sample,
            quasi_static,
            inst.sensors.kind == "current",
            seed,
        )
        self._columns = columns_by_name(self._core.commands)
        self._signals = columns_by_name(self._core.signals)
        taken = {name: width for name, width in self._core.commands if name not in _NOT_TAKEN}
        if inst.grip is None:
            del taken["grip_force"]
        if len(self.axes) == len(inst.tip_joints):
            taken |= {"force": len(self.axes), "radial_force": len(self.axes)}
        self.widths: Mapping[str, int] = taken
        self.cores: list[Any] = [self._core]

    @property
    def state(self) -> tuple[bytes, ...]:
        """The complete state."""
        return (self._core.state,)

    @state.setter
    def state(self, state: tuple[bytes, ...]) -> None:
        (self._core.state,) = state

    def check(self, commands: Mapping[str, Array]) -> None:
        """Raise ArgumentError for a handle angle beyond its joint's range."""
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

    def rows(self, commands: Mapping[str, Array], constant: Constant) -> Array:
        """Return the commands as rows."""
        if constant.axes not in ("tip", "stem"):
            raise ArgumentError(key="axes", value=constant.axes, allowed="tip or stem")
        rows = np.zeros((len(commands["handle_angle"]), sum(width for _, width in self._core.commands)))
        for name, values in commands.items():
            if name in self._columns:
                rows[:, self._columns[name]] = values
        if "force" in commands:
            self._add_forces(rows[:, self._columns["wrench"]], commands, constant)
        rows[:, self._columns["in_stem_axes"]] = constant.axes == "stem"
        rows[:, self._columns["held"]] = (0.0, 0.0, 0.0) if constant.held is None else constant.held
        tissue = [NO_TISSUE if contact is None else contact.row for contact in constant.contact]
        rows[:, self._columns["contact"]] = np.ravel(tissue)
        return rows

    def _add_forces(self, wrench: Array, commands: Mapping[str, Array], constant: Constant) -> None:
        """Add forces of axes to a wrench in the tip's axes: yaw bends toward x, pitch toward y."""
        for n, axis in enumerate(self.axes):
            wrench[:, ("yaw", "pitch").index(axis)] -= commands["force"][:, n]
            wrench[:, 2] += commands["radial_force"][:, n]
        if constant.axes != "tip" and (commands["force"].any() or commands["radial_force"].any()):
            raise ArgumentError(key="axes", value=constant.axes, allowed="tip, with the forces of axes")

    def commanded(self, rows: Array, *, tissue: bool) -> dict[str, Array]:
        """Return the commands that are signals of a run."""
        commands = {name: rows[:, columns] for name, columns in self._columns.items()}
        return signals_of_commands(commands, tissue=tissue, grip=self.inst.grip is not None)

    def run(self, rows: Array) -> Outcome:
        """Step over commands."""
        out = self._room(len(rows))
        steps, status = self._core.run(rows, out, None)
        return Outcome(steps, Status(status), "", self.named(out))

    def run_controlled(self, controller: _core.Controller, rows: Array, ticks: Ticks) -> Outcome:
        """Step over commands, with a controller in the loop."""
        out = self._room(len(rows))
        control = np.empty((len(rows), len(self._pairs), len(CONTROL)))
        steps, status = self._core.run_controlled(
            controller,
            self._pairs,
            rows,
            self.steps_per_tick,
            ticks.time_step,
            ticks.relay,
            ticks.first_step,
            ticks.requests,
            ticks.values,
            ticks.modes,
            out,
            control,
        )
        return Outcome(steps, Status(status), "", self.named(out), control)

    def audit(self, rows: Array) -> tuple[int, Status, list[float]]:
        """Step over commands and return the values of an energy balance."""
        totals = np.zeros(len(_core.wrist_energies()))
        steps, status = self._core.run(rows, self._room(len(rows)), totals)
        return steps, Status(status), totals.tolist()

    def device(self, time_step: float) -> "_core.LiveDevice":
        """Return it as a device of the live loop, whose time step is in s."""
        return _core.ChainDevice(self._core, time_step, self.steps_per_tick)

    def now(self) -> Mapping[str, Array]:
        """Return the signals as they stand."""
        out = self._room(1)
        self._core.now(out[0])
        return self.named(out)

    def handle_wanted(self) -> Array:
        """Return the angles of the handle's joints by the last command, rad."""
        return np.array([self._core.handle_wanted(n) for n in range(len(self.inst.handle_joints))])

    def tissue(self) -> list[tuple[float, float, float]]:
        """Return the tissue of the last command, by joint."""
        return [self._core.contact(n) for n in range(len(self.inst.tip_joints))]

    def _room(self, count: int) -> Array:
        return np.empty((count, sum(width for _, width in self._core.signals)))

    def named(self, out: Array) -> dict[str, Array]:
        """Return rows of the core's signals by name; their last axis is that of the columns."""
        return {name: out[..., columns] for name, columns in self._signals.items() if name not in _UNSEEN}
