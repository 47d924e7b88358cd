"""The protocol that a live runtime runs, as long as its operator stays and it is not stopped."""

import threading
import time
from collections.abc import Callable
from typing import Any

from tenodesis.errors import LiveError
from tenodesis.live.journal import Journal
from tenodesis.live.lease import Lease
from tenodesis.live.loop import LiveLoop
from tenodesis.live.protocol_feed import Player
from tenodesis.live.recording_process import RecordingProcess
from tenodesis.live.status import ProtocolState, ProtocolStatus
from tenodesis.run import Array
from tenodesis.simulate import Protocol

_SETTLING = 0.05
"""Time between a protocol's acceptance and its first row, s."""
_HOLDING = ("pause", "disable")
"""Requests after which a protocol neither homes nor resumes by itself, until a request of the second set."""
_FREEING = ("enable", "resume", "home")


class ProtocolRunner:
    """Runs at most one protocol at a time on a loop.

    Parameters
    ----------
    loop
        Takes the commands.
    lease
        Returns whether the operator is still there.
    recorder
        Records the protocol, if that is wanted.
    journal
        Where its end is written down.
    latest
        Returns the newest tick, as :class:`~tenodesis.live.protocol_feed.Player` needs it.
    """

    def __init__(
        self,
        loop: LiveLoop,
        lease: Lease,
        recorder: RecordingProcess,
        journal: Journal,
        latest: Callable[[], dict[str, Any]],
    ) -> None:
        self._loop, self._lease, self._recorder, self._journal, self._latest = loop, lease, recorder, journal, latest
        self._player: Player | None = None
        self._operator: object = None
        self._records = False
        self._begin_after = 0.0
        self._status: ProtocolStatus | None = None
        self._lock = threading.Lock()
        self._requesting = threading.Lock()
        self.stops = 0
        """Number of stops of the motors."""

    @property
    def status(self) -> ProtocolStatus | None:
        """The protocol that runs, or ran last."""
        with self._lock:
            return self._status

    def refuse_while_playing(self) -> None:
        """Raise LiveError while a protocol runs."""
        if self._player is not None:
            raise LiveError(f"the protocol {self._name} runs; cancel it first.", key="protocol", value=self._name)

    def request(self, what: str) -> None:
        """Pass an operator's request to the controller; after a pause by the operator no protocol resumes."""
        with self._requesting:
            player = self._player
            if player is not None:
                player.held = what in _HOLDING or (player.held and what not in _FREEING)
            self._loop.request(what)

    def play(self, protocol: Protocol, operator: object, *, record: bool, stops: int) -> None:
        """Begin a protocol for its operator, unless the motors were stopped meanwhile.

        Raises
        ------
        LiveError
            Another runs, the device cannot do it, or it was stopped before it began.
        ProtocolError
            The instrument cannot run it.
        """
        self.refuse_while_playing()
        loop = self._loop
        if not loop.capabilities.simulated:
            raise LiveError("protocols move the handle, load the tip and place tissue, which only the twin allows.")
        player = Player(
            protocol.plan(loop.inst, loop.period),
            _Rows(loop, lambda rows: self._push(rows, stops)),
            lambda what: self._request_by_protocol(what, stops),
            self._latest,
            inst=loop.inst,
            assumed=loop.assumed,
            columns=loop.commands,
            time_step=loop.period,
        )
        with self._lock:
            if self.stops != stops or not self._lease.held_by(operator):
                raise LiveError("it was stopped, or the operator went, before the protocol began.")
            self.refuse_while_playing()
            # A handle that still follows a slider would be elsewhere by the time the first rows are taken.
            loop.drop()
            if record and not self._recorder.recording:
                self._recorder.start(protocol.name)
                self._records = True
            self._begin_after = time.monotonic() + _SETTLING
            self._player, self._operator = player, operator
            self._status = ProtocolStatus(protocol.name, *player.progress, ProtocolState.RUNNING)

    def advance(self) -> None:
        """Let the protocol send what is due; to be called every 20 ms or so."""
        with self._lock:
            player, status = self._player, self._status
            if player is None or status is None or time.monotonic() < self._begin_after:
                return
            if self._records and not self._recorder.ready:
                return
            if not self._lease.held_by(self._operator):
                self._end("the operator has left")
                return
            try:
                player.advance()
            except Exception as problem:
                self._end(str(problem))
                raise
            state = ProtocolState.RUNNING if player.problem is None else ProtocolState.WAITING
            self._status = ProtocolStatus(status.name, *player.progress, state, player.problem)
            if player.finished:
                self._end(None)

    def stop(self) -> None:
        """Stop the motors, and with them the protocol."""
        self._loop.stop()
        with self._requesting:
            # From here on no protocol requests anything; what it requested before is stopped.
            self.stops += 1
            self._loop.stop()
        self.end("stopped")

    def end(self, why: str) -> None:
        """End the protocol before it is done, for a reason."""
        with self._lock:
            self._end(why)

    def leave_recording(self) -> None:
        """Leave the recorder as it is when the protocol ends; the caller controls it."""
        with self._lock:
            self._records = False

    @property
    def _name(self) -> str:
        return "" if self._status is None else self._status.name

    # What a protocol requests and sends comes before a stop or not at all.
    def _request_by_protocol(self, what: str, stops: int) -> None:
        with self._requesting:
            player = self._player
            if what in _HOLDING or (self.stops == stops and player is not None and not player.held):
                self._loop.request(what)

    def _push(self, rows: Array, stops: int) -> int:
        with self._requesting:
            return self._loop.push(rows) if self.stops == stops else 0

    # With the lock held.
    def _end(self, why: str | None) -> None:
        player, self._player = self._player, None
        if player is None:
            return
        if why is not None:
            try:
                player.cancel()
            except LiveError:
                # A protocol that cannot be cancelled is stopped, which is never refused.
                self._loop.stop()
        state = ProtocolState.DONE if why is None else ProtocolState.ENDED
        self._status = ProtocolStatus(self._name, *player.progress, state, why)
        self._journal.write("protocol_ended", "runtime", protocol=self._name, why=why or "done")
        if self._records:
            self._records = False
            self._recorder.stop_soon()


class _Rows:
    """The loop's queue of played ticks, in the form that a protocol feed needs."""

    def __init__(self, loop: LiveLoop, push: Callable[[Array], int]) -> None:
        self._loop, self.push = loop, push
        self.drop = loop.drop

    @property
    def pending(self) -> int:
        return self._loop.pending
