"""A live loop with its operator's lease, its protocol, its recorder and its events."""

import logging
import math
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from tenodesis.control import OperatingState
from tenodesis.control.controller import fault_names, homing_failure
from tenodesis.errors import LiveError
from tenodesis.files import write_errors
from tenodesis.live.journal import Journal
from tenodesis.live.layout import TICK
from tenodesis.live.lease import Lease
from tenodesis.live.loop import LiveLoop
from tenodesis.live.protocol_runner import ProtocolRunner
from tenodesis.live.recording_process import RecordingProcess
from tenodesis.live.status import RuntimeState, Status, Timing
from tenodesis.live.ticks import Reader
from tenodesis.run import fault_bits
from tenodesis.twin import Held

_TURN = 0.02
"""Time between two checks, s."""
_MISSED_EVERY = 0.25
"""Time between two events about missed ticks, s."""
_log = logging.getLogger(__name__)


class Runtime:
    """Runs a loop from `start` to `finish`.

    Parameters
    ----------
    loop
        The loop; it is started and finished here.
    recordings
        Folder of recordings.

    Raises
    ------
    LiveError
        The folder cannot be written.
    """

    def __init__(self, loop: LiveLoop, recordings: Path) -> None:
        self.loop = loop
        self._reader = Reader(loop.folder)
        with write_errors(loop.folder, LiveError):
            self.journal = Journal(loop.folder, self._time)
        self.recorder = RecordingProcess(loop.folder, recordings)
        self.lease = Lease(loop.core.lease)
        self.protocols = ProtocolRunner(loop, self.lease, self.recorder, self.journal, self._reader.signals)
        self._ending = threading.Event()
        self._upkeep = threading.Thread(target=self._look_after, name="upkeep", daemon=True)
        self._state: tuple[RuntimeState, tuple[str, ...]] | None = None
        self._trouble: tuple[bool, str | None] = (False, None)
        self._missed = (0, 0.0)
        self._operator: str | None = None

    def start(self) -> None:
        """Begin to tick."""
        self.loop.start()
        self.journal.write("started", "runtime", law=self.loop.law, actuation=self.loop.actuation)
        self._upkeep.start()

    def finish(self) -> None:
        """Stop the motors, close the recording, and end."""
        self._ending.set()
        self.loop.finish()
        self.protocols.leave_recording()
        self.protocols.end("the runtime has ended")
        # What it writes down is the last that the recorder reads; a thread that is held up has nothing to add.
        self._upkeep.join(1.0)
        self.journal.write("ended", "runtime")
        self.recorder.stop()
        self.journal.close()

    def release(self, holder: object, origin: str) -> None:
        """End the lease of the operator, and pause; do nothing for any other client."""
        if self._ending.is_set() or not self.lease.release(holder):
            return
        with suppress(LiveError):
            self.loop.request("pause")
        self.journal.write("operator_gone", origin)

    def hold(self, held: Held | None) -> None:
        """Put something between the jaws as they are now, or take it away."""
        self.loop.hold(held, self._reader.signals().get("output_angle", np.zeros(len(self.loop.inst.tip_joints))))

    def status(self) -> Status:
        """Return the state of the runtime."""
        loop, core = self.loop, self.loop.core
        tick = self._reader.signals()
        recorder = self.recorder
        lost = int(recorder.status().get("lost", 0)) if recorder.path is not None else 0
        compute, control, lateness = core.compute, core.control, core.lateness
        return Status(
            state=_state(tick),
            homed=bool(tick.get("homed", 0)),
            homing=bool(tick.get("homing", 0)),
            stopped=bool(tick.get("stopped", 0)),
            faults=_faults(tick),
            first_faults=fault_names(int(tick.get("first_faults", 0))),
            law=loop.law,
            actuation=loop.actuation,
            operator=self.lease.origin,
            timing=Timing(
                ticks=core.ticks,
                late=core.late,
                missed=core.missed + loop.unanswered,
                lost=lost,
                p50=compute[0],
                p99=compute[1],
                worst=compute[2],
                controller_p50=control[0],
                controller_worst=control[2],
                lateness_p99=lateness[1],
                lateness_worst=lateness[2],
                rate=1 / loop.period,
            ),
            realtime=tuple(core.refused),
            protocol=self.protocols.status,
            recording=recorder.path,
            recorder_lost=lost,
            speed=core.speed,
            problem=self._problem(),
            homing_failures=_homing_failures(tick, loop.axes),
            wound={axis: wound for n, axis in enumerate(loop.axes) if math.isfinite(wound := core.wound(n))},
        )

    def _time(self) -> float:
        row = self._reader.newest()
        return 0.0 if row is None else float(row[TICK.index("time")])

    def _problem(self) -> str | None:
        return self.loop.problem or self.recorder.problem or self.journal.problem

    def _look_after(self) -> None:
        while not self._ending.wait(_TURN):
            for work in (self.protocols.advance, self.recorder.look, self._write_changes, self.journal.flush):
                try:
                    work()
                except Exception:
                    # What goes wrong in one of them must not end the others.
                    _log.exception("looking after the loop failed")

    def _write_changes(self) -> None:
        tick = self._reader.signals()
        if not tick:
            return
        state, faults = _state(tick), _faults(tick)
        if (state, faults) != self._state:
            self._state = (state, faults)
            first = fault_names(int(tick["first_faults"]))
            self.journal.write("state", "runtime", state=state, faults=faults, first_faults=first)
        trouble = (bool(tick["stopped"]), self._problem())
        if trouble != self._trouble:
            self._trouble = trouble
            self.journal.write("problem", "runtime", stopped=trouble[0], text=trouble[1])
        operator = self.lease.origin
        if self._operator is not None and operator is None:
            self.journal.write("no_operator", "runtime", before=self._operator)
        self._operator = operator
        self._write_missed()

    def _write_missed(self) -> None:
        missed, (known, written) = self.loop.core.missed + self.loop.unanswered, self._missed
        if missed < known:
            self._missed = (missed, written)
        elif missed > known and time.monotonic() - written >= _MISSED_EVERY:
            self._missed = (missed, time.monotonic())
            self.journal.write("ticks_missed", "runtime", ticks=missed - known, in_all=missed)


def _state(tick: dict[str, Any]) -> RuntimeState:
    return RuntimeState[OperatingState(int(tick.get("state", 0.0))).name]


def _homing_failures(tick: dict[str, Any], axes: tuple[str, ...]) -> dict[str, str]:
    words = np.nan_to_num(np.atleast_1d(tick.get("homing_failure", 0.0))).astype(np.int64)
    return {axis: homing_failure(int(word)) for axis, word in zip(axes, words, strict=False) if word}


def _faults(tick: dict[str, Any]) -> tuple[str, ...]:
    return fault_names(int(fault_bits([np.atleast_1d(tick.get("faults", 0.0))])[0]))
