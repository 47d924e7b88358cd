"""A board with the firmware as a device, its controller disabled, to measure how well its line works."""

import time
from math import nan

import numpy as np

from tenodesis import _core
from tenodesis.devices.device import Capabilities, Device, Measurement
from tenodesis.devices.serial import BoardController, SerialController, StreamedController
from tenodesis.errors import DeviceError
from tenodesis.instrument import ShortForm
from tenodesis.instrument.devices import Serial
from tenodesis.run import Array


class SerialDevice(Device):
    """The line to a board: what it measures by itself, or how soon it answers a tick."""

    def __init__(self, inst: ShortForm, settings: Serial) -> None:
        self._inst, self._settings = inst, settings
        self._streams = settings.sensors == "board"
        rate = inst.sensors.sampling_rate
        self.capabilities = Capabilities(
            "serial", inst.axes, rate, self._streams, not self._streams, False, 1 / rate, inst.control.watchdog
        )
        self._controller: BoardController | None = None
        self._bench: _core.StreamedDevice | None = None
        self._lost = 0
        self.round_trip = nan
        """From a tick's question to its answer, s; NaN where the board ticks by itself."""

    @property
    def counts(self) -> dict[str, int]:
        """Number of frames that were lost, damaged or late, by kind."""
        if self._controller is None:
            return {}
        counts = self._controller.link_counts
        return {
            "lost": self._lost,
            "repeated": counts.repetitions,
            "damaged": counts.damaged,
            "stale": counts.stale,
            "damaged on the board": counts.board_damaged,
        }

    def open(self) -> None:
        """Begin a session with the board, its controller disabled.

        Raises DeviceError if there is no such port, no board behind it, or an unsuitable one.
        """
        settings = self._settings
        kind = StreamedController if self._streams else SerialController
        self._controller = kind(
            settings.port,
            self._inst,
            homed=False,
            enabled=False,
            timeout=settings.timeout,
            baud_rate=settings.baud_rate,
        )
        if isinstance(self._controller, StreamedController):
            self._bench = self._controller.device()

    def read(self, timeout: float) -> Measurement | None:
        """Return what the board has measured, or the measurement that it was sent and has answered.

        Raises DeviceError if the link has failed.
        """
        if self._controller is None:
            raise DeviceError("the board is not open; open it first.")
        measured = self._answered(self._controller) if self._bench is None else self._heard(self._bench, timeout)
        if self._controller.problem is not None:
            raise DeviceError(f"{self._settings.port}: {self._controller.problem.text}.")
        return measured

    def _answered(self, controller: BoardController) -> Measurement:
        axes = len(self._inst.axes)
        angle, spools = np.zeros(axes), np.zeros((axes, 2))
        tension = np.full((axes, 2), self._inst.pretension)
        began = time.monotonic()
        if axes == 1:
            controller.step(began, angle[0], tension[0], spools[0])
        else:
            controller.step(began, angle, tension, spools)
        now = time.monotonic_ns()
        self.round_trip = now / 1e9 - began
        return Measurement(now, angle, tension, spools, np.full(axes, nan))

    def _heard(self, bench: "_core.StreamedDevice", timeout: float) -> Measurement | None:
        found = bench.read(timeout)
        if found is None:
            return None
        self._lost += bench.overtaken()
        rows = np.array(found[1])
        return Measurement(found[0], rows[:, 0], rows[:, 1:3], rows[:, 3:5], np.full(len(rows), nan))

    def write(self, spool_velocity: Array) -> None:
        """Keep the connection to the board alive; its motors rest, whatever the speed."""
        del spool_velocity
        if self._bench is not None:
            self._bench.rest()

    def close(self) -> None:
        """Stop the board, and release it; a second time does nothing."""
        if self._controller is not None:
            self._controller.close()
