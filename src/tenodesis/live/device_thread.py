"""The thread between a Python device and the live loop: posts measurements, sends the answers to the motors."""

import logging
import threading

import numpy as np

from tenodesis import _core
from tenodesis.devices.device import Device
from tenodesis.errors import DeviceError
from tenodesis.run import Array

_log = logging.getLogger(__name__)


class DeviceThread:
    """A thread that serves a device; the loop waits for it no longer than two ticks.

    Where no answer comes in time, the motors are commanded to rest; where the device fails, it is closed, which stops
    them; where a motor does not obey, their supply is cut.

    Parameters
    ----------
    device
        The device, open.
    box
        The loop's side of it.
    period
        Of ticks, s.
    """

    def __init__(self, device: Device, box: "_core.MailboxDevice", period: float) -> None:
        self._device, self._box = device, box
        self._period = period
        self._ending = threading.Event()
        self.problem: str | None = None
        """Why the device is no longer served."""
        self.unanswered = 0
        """Measurements to which no answer came in time."""
        self._thread = threading.Thread(target=self._serve, name="device", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def finish(self) -> None:
        """Stop the motors and end; a second time does nothing."""
        self._ending.set()
        if self._thread.ident is None:
            self._device.close()
            return
        self._thread.join(timeout=5)
        if self._thread.is_alive():
            self.problem = "the device does not answer and could not be closed; switch the motors' supply off."

    def _serve(self) -> None:
        rest = np.zeros(self._device.capabilities.spools)
        try:
            while not self._ending.is_set() and not self._box.stopped:
                measured = self._device.read(4 * self._period)
                if measured is None:
                    self._command(rest, rest)
                    continue
                values = (measured.handle_angle, measured.tension, measured.spool_angle, measured.output_angle)
                self._box.post(measured.time, *(np.ravel(value).tolist() for value in values))
                answered, velocity, tension = self._box.take(4 * self._period)
                self.unanswered += not answered
                if self._box.power_cut:
                    self.problem = (
                        "a motor does not obey; the supply of all motors was cut, as far as the bench can. Find the "
                        "cause, then connect again."
                    )
                    self._device.cut_power()
                    break
                sound = answered and np.isfinite([velocity, tension]).all()
                said = (np.reshape(velocity, rest.shape), np.reshape(tension, rest.shape)) if sound else (rest, rest)
                self._command(*said)
        except DeviceError as problem:
            self.problem = str(problem)
        except Exception as problem:
            # Whatever a driver raises must leave motors at rest and be reported, not end a thread unseen.
            _log.exception("the device failed")
            self.problem = f"the device failed: {problem}"
        finally:
            try:
                self._device.close()
            except Exception as problem:
                _log.exception("the device could not be closed")
                self.problem = self.problem or f"the device could not be closed: {problem}"

    def _command(self, velocity: Array, tension: Array) -> None:
        if self._device.capabilities.holds_tension:
            self._device.hold(tension)
        self._device.write(velocity)
