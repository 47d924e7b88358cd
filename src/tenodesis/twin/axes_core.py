"""Axes that do not act on each other: a twin of the core for each, side by side."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tenodesis import _core, plant
from tenodesis._core import Status
from tenodesis.errors import ArgumentError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array, Names
from tenodesis.twin.contact import NO_TISSUE
from tenodesis.twin.core import Constant, Outcome, Ticks
from tenodesis.twin.rows import (
    ARGUMENTS,
    COMMANDS,
    CONTROL,
    PER_TENDON,
    SIGNALS,
    SIMULATED,
    check_handle_range,
    check_rig,
    commanded,
    of_axes,
)

_NEXT_AXIS = 0x9E3779B97F4A7C15 << 40
"""Axes draw from distant parts of the same random sequence, whose increment is this odd number."""


class AxesCore:
    """The twins of a planar instrument's axes."""

    def __init__(self, inst: ShortForm, time_step: float, seed: int, quasi_static: bool) -> None:
        self.inst = inst
        self.axes: tuple[str, ...] = inst.axes
        self.names = Names.paired(inst.axes)
        self.kind = f"{inst.joint_type} joints of {inst.name}, {len(inst.axes)} axes"
        count = len(inst.axes)
        self.widths: Mapping[str, int] = {
            name: count * (2 if name in PER_TENDON else 1) for name in ARGUMENTS if name != "contact"
        }
        self.own_tendons: Sequence[int] = range(len(self.names.tendons))
        self.spool_radius = inst.drives.spool_radius
        ratio = inst.mismatch.pretension_ratio / inst.mismatch.stiffness_ratio
        self.stretch = ratio * max(axis.pretension / axis.tendon_stiffness for axis in inst.planar)
        self.cores: list[Any] = [
            _core.Twin(plant.spec(planar, time_step, quasi_static), (seed + n * _NEXT_AXIS) % 2**64)
            for n, planar in enumerate(inst.planar)
        ]
        self.steps_per_tick = plant.steps_per_sample(inst, time_step, quasi_static)

    @property
    def state(self) -> tuple[bytes, ...]:
        """The state of each axis."""
        return tuple(core.state for core in self.cores)

    @state.setter
    def state(self, state: tuple[bytes, ...]) -> None:
        for core, kept in zip(self.cores, state, strict=True):
            core.state = kept

    def check(self, commands: Mapping[str, Array]) -> None:
        """Raise ArgumentError for a handle angle beyond the handle's range, or a weight without a rig."""
        if commands["weight"].any():
            check_rig(self.inst)
        for axis, planar, angles in zip(self.axes, self.inst.planar, commands["handle_angle"].T, strict=True):
            if not planar.dynamics.hand_stiffness:
                check_handle_range(planar, angles, axis if len(self.axes) > 1 else "")

    def rows(self, commands: Mapping[str, Array], constant: Constant) -> list[Array]:
        """Return the commands of each axis."""
        if constant.axes != "tip":
            raise ArgumentError(key="axes", value=constant.axes, allowed="tip, with the forces of a planar instrument")
        rows = np.zeros((len(self.axes), len(commands["handle_angle"]), len(COMMANDS)))
        for name, values in commands.items():
            for n, row in enumerate(rows):
                row[:, ARGUMENTS[name]] = values[:, 2 * n : 2 * n + 2] if name in PER_TENDON else values[:, n]
        for row, contact in zip(rows, constant.contact, strict=True):
            row[:, ARGUMENTS["contact"]] = NO_TISSUE if contact is None else contact.row
        return list(rows)

    def commanded(self, rows: list[Array], *, tissue: bool) -> dict[str, Array]:
        """Return the commands that are signals of a run."""
        return commanded(rows, tissue=tissue)

    def run(self, rows: list[Array]) -> Outcome:
        """Step every axis over its commands."""
        outs = []
        for axis, core, row in zip(self.axes, self.cores, rows, strict=True):
            out = np.empty((len(row), len(SIGNALS)))
            steps, status = core.run(row, out)
            if status != Status.OK:
                return Outcome(steps, Status(status), f"{axis}, ", {})
            outs.append(out)
        return Outcome(len(rows[0]), Status.OK, "", _named(outs))

    def run_controlled(self, controller: _core.Controller, rows: list[Array], ticks: Ticks) -> Outcome:
        """Step all axes, with a controller in the loop."""
        count = len(rows[0])
        outs = np.empty((len(rows), count, len(SIGNALS)))
        control = np.empty((len(rows), count, len(CONTROL)))
        steps, status = _core.run_controlled(
            self.cores,
            controller,
            np.stack(rows),
            self.steps_per_tick,
            ticks.time_step,
            ticks.relay,
            ticks.first_step,
            ticks.requests,
            ticks.values,
            ticks.modes,
            outs,
            control,
        )
        return Outcome(steps, Status(status), "", _named(list(outs)), control.swapaxes(0, 1))

    def audit(self, rows: list[Array]) -> tuple[int, Status, list[float]]:
        """Step over commands and return the values of an energy balance, of one axis."""
        if len(self.cores) != 1:
            raise ArgumentError(f"{self.inst.name} has two axes; it must have one: make the twin of inst.axis(name).")
        steps, status, energies, *worst = self.cores[0].audit(rows[0])
        return steps, Status(status), [*energies, *worst]

    def device(self, time_step: float) -> "_core.LiveDevice":
        """Return it as a device of the live loop, whose time step is in s."""
        return _core.AxesDevice(self.cores, time_step, self.steps_per_tick)

    def now(self) -> Mapping[str, Array]:
        """Return the signals as they stand."""
        return _named([np.array([core.signals(np.zeros((1, len(COMMANDS))))]) for core in self.cores])

    def handle_wanted(self) -> Array:
        """Return the angles of the handle's joints by the last command, rad."""
        return np.array([core.handle_wanted for core in self.cores])

    def tissue(self) -> list[tuple[float, float, float]]:
        """Return the tissue of the last command, by axis."""
        return [core.contact for core in self.cores]


def _named(outs: list[Array]) -> dict[str, Array]:
    return {name: of_axes(outs, columns) for name, columns in SIMULATED.items()}
