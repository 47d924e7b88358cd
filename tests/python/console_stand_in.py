"""A live instrument within the test's own process, as the page sees one: twin and controller in a thread."""

import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import tenodesis as tn
from tenodesis.control import Controller, OperatingState, Request
from tenodesis.control.controller import fault_names
from tenodesis.devices.device import Capabilities
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml
from tenodesis.live.commands import ControllerRequest, RestartableConnection
from tenodesis.live.status import ProtocolState, ProtocolStatus, RuntimeState, Status, Timing
from tenodesis.run import Array, Run, concatenate
from tenodesis.simulate import FaultInjection, Protocol
from tenodesis.simulate.command import sampled

TIME_STEP = 5e-4
_BLOCK = 20
_HAND_SPEED = 1.5  # rad/s
LEASE = 30.0
"""More than an instrument gives, s: of a test, page and browser wait for the processor together."""
_KEPT = 12.0  # s


SHORT_PROTOCOL = """
name = "short"
[[phases]]
kind = "step-load"
output_angle = "20 deg"
delay = "0.2 s"
force = "1 N"
duration = "0.5 s"
release = "0.3 s"
"""


@dataclass
class StandIn:
    """The instrument; :meth:`connect` opens connections to it, `commands` lists who asked for what."""

    inst: Instrument
    folder: Path
    simulated: bool = True
    commands: list[tuple[str, str]] = field(default_factory=list)
    operator: str | None = None
    forces: Array = field(default_factory=lambda: np.zeros(2))
    hands: Array = field(default_factory=lambda: np.zeros(2))

    def __post_init__(self) -> None:
        self.lock = threading.RLock()
        self.done = threading.Event()
        self.recorded = 0
        self.begin(self.inst)
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def begin(self, inst: Instrument) -> None:
        with self.lock:
            self.inst = inst
            self.twin = tn.twin.Twin(inst, time_step=TIME_STEP, seed=1)
            self.controller = Controller(inst, enabled=False)
            self.runs: deque[Run] = deque(maxlen=round(_KEPT / (_BLOCK * TIME_STEP)))
            self.ticks = 0
            axes = len(inst.axes)
            self.hands, self.forces, self.at = np.zeros(axes), np.zeros(axes), np.zeros(axes)
            self.beat, self.rate, self.problem = time.monotonic(), 1.0, None
            self.faults: list[FaultInjection] = []
            self.playing: Iterator[Mapping[str, Array]] | None = None
            self.protocol: ProtocolStatus | None = None
            self.recorder: tn.Recorder | None = None
            self.runs.append(self.block())

    def connect(self, origin: str) -> "StandInConnection":
        return StandInConnection(self, origin)

    def close(self) -> None:
        self.done.set()
        self.thread.join()

    def block(self) -> Run:
        """Go on by some ticks."""
        axes = len(self.inst.axes)
        commands = None if self.playing is None else next(self.playing, None)
        if commands is None:
            self.end_protocol()
            most = _HAND_SPEED * TIME_STEP
            steps = np.arange(1, _BLOCK + 1)[:, np.newaxis] * most
            way = self.hands - self.at
            path = self.at + np.sign(way) * np.minimum(steps, np.abs(way))
            load = np.broadcast_to(self.forces, path.shape)
            commands = {"handle_angle": path, "force": load}
            commands = {name: values[:, 0] if axes == 1 else values for name, values in commands.items()}
        count = len(commands["handle_angle"])
        run = self.twin.run(
            commands["handle_angle"],
            commands["force"],
            controller=self.controller,
            fault_injection=[one for one in self.faults if one.stop > self.twin.time],
        )
        self.at = commands["handle_angle"][-1].reshape(axes)
        self.ticks += count
        if self.recorder is not None and self.protocol is not None:
            self.recorder.write(run)
            done = min(self.protocol.total, self.protocol.done + count * TIME_STEP)
            self.protocol = self.protocol._replace(done=done)
        return run

    def end_protocol(self, why: str | None = None) -> None:
        if self.recorder is not None:
            self.recorder.close()
            self.recorder = None
            self.hands = self.at.copy()
        self.playing = None
        if self.protocol is not None and self.protocol.runs:
            name, done, total, *_ = self.protocol
            if why is None:
                self.protocol = ProtocolStatus(name, total, total, ProtocolState.DONE)
            else:
                self.protocol = ProtocolStatus(name, done, total, ProtocolState.ENDED, why)

    def play(self, protocol: Protocol) -> None:
        seconds = protocol.duration(self.inst, TIME_STEP)
        self.recorded += 1
        path = self.folder / f"{self.recorded:03d}-{protocol.name}.mcap"
        metadata = {"instrument": to_toml(self.inst), "protocol": protocol.to_toml()}
        self.recorder = tn.Recorder(path, axes=self.inst.axes, metadata=metadata)
        segments = [segment for planned in protocol.plan(self.inst, TIME_STEP) for segment in planned.segments]
        self.playing = sampled(segments, _BLOCK)
        self.protocol = ProtocolStatus(protocol.name, 0.0, seconds, ProtocolState.RUNNING)

    def _run(self) -> None:
        due = time.monotonic()
        while not self.done.is_set():
            with self.lock:
                if self.operator is not None and time.monotonic() - self.beat > LEASE:
                    self.commands.append((self.operator, "lease ran out"))
                    self.operator = None
                    self.controller.ask(Request.PAUSE)
                self.runs.append(self.block())
            due = max(due + _BLOCK * TIME_STEP / self.rate, time.monotonic() - 0.2)
            self.done.wait(max(0.0, due - time.monotonic()))
        with self.lock:
            self.end_protocol()


class StandInConnection(RestartableConnection):
    """A connection in the name of an origin."""

    def __init__(self, bench: StandIn, origin: str) -> None:
        self.bench, self.origin = bench, origin

    @property
    def inst(self) -> Instrument:
        return self.bench.inst

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities("stand-in", self.inst.axes, 1 / TIME_STEP, False, self.bench.simulated, True, 0.0, 0.0)

    def latest(self) -> dict[str, Any]:
        run = self.bench.runs[-1]
        return {"time": run.time[-1], **{name: values[-1] for name, values in run.signals().items()}}

    def history(self, seconds: float, rows: int = 500) -> dict[str, Array]:
        with self.bench.lock:
            run = concatenate(list(self.bench.runs))
        last = np.flatnonzero(run.time >= run.time[-1] - seconds)
        kept = np.unique(np.linspace(last[0], last[-1], min(rows, last.size)).astype(int))
        return {"time": run.time[kept], **{name: values[kept] for name, values in run.signals().items()}}

    def status(self) -> Status:
        bench = self.bench
        with bench.lock:
            run = bench.runs[-1]
            return Status(
                state=RuntimeState(OperatingState(int(run["operating_state"][-1].max())).name),
                homed=True,
                homing=False,
                stopped=False,
                faults=fault_names(int(run["faults"][-1].max())),
                first_faults=(),
                law=bench.controller.law,
                actuation=bench.controller.actuation,
                operator=bench.operator,
                timing=Timing(1 / TIME_STEP, bench.ticks, 0, 0, 0, 31e-6, 48e-6, 210e-6, 5e-6, 50e-6, 1e-4, 2e-4),
                realtime=("Real-time scheduling was not granted.",),
                protocol=bench.protocol,
                recording=None,
                recorder_lost=0,
                speed=bench.rate,
                problem=bench.problem,
            )

    def acquire(self, force: bool = False) -> bool:
        bench = self.bench
        with bench.lock:
            if bench.operator not in (None, self.origin) and not force:
                return False
            bench.commands.append((self.origin, f"acquire from {bench.operator}" if force else "acquire"))
            bench.operator, bench.beat = self.origin, time.monotonic()
        return True

    def release(self) -> None:
        self._ask("release")
        self.bench.operator = None
        self.bench.controller.ask(Request.PAUSE)

    def heartbeat(self) -> bool:
        operates = self.bench.operator == self.origin
        if operates:
            self.bench.beat = time.monotonic()
        return operates

    def restart(self) -> None:
        self._ask("restart")

    def hand(self, angles: ArrayLike) -> None:
        self._ask("hand")
        self.bench.hands = np.array(angles)

    def force(self, force: ArrayLike) -> None:
        self._ask("force")
        self.bench.forces = np.array(force)

    def request(self, what: ControllerRequest) -> None:
        self._ask(what)
        self.bench.controller.ask(what)

    def stop(self) -> None:
        self.stop_for(self.origin)

    def stop_for(self, origin: str) -> None:
        self.bench.commands.append((origin, "stop"))
        self.bench.controller.ask(Request.PAUSE)

    def law(self, law: Any, actuation: Any) -> None:
        self._ask(f"law {law} {actuation}")
        bench = self.bench
        with bench.lock:
            enabled = self.status().state == "ENABLED"
            bench.controller = Controller(bench.inst, law=law, actuation=actuation, enabled=enabled)

    def speed(self, factor: float) -> None:
        self._ask(f"speed {factor}")
        self.bench.rate = factor

    def load(self, instrument: str) -> None:
        self._ask("load")
        self.bench.begin(tn.parse(instrument) if "\n" in instrument else tn.load(instrument))

    def inject_fault(self, point: Any, mode: Any, value: float, seconds: float, axis: str | None = None) -> None:
        self._ask(f"inject_fault {point}")
        bench = self.bench
        with bench.lock:
            now = bench.twin.time
            bench.faults = [FaultInjection(point, mode, value, start=now, stop=now + seconds)]

    def play(self, protocol: Protocol, record: bool = True) -> None:
        self._ask(f"play {protocol.name}")
        with self.bench.lock:
            self.bench.play(protocol)

    def cancel(self) -> None:
        self._ask("cancel")
        with self.bench.lock:
            self.bench.end_protocol("cancelled")

    def close(self) -> None:
        pass

    def _ask(self, what: str) -> None:
        bench = self.bench
        with bench.lock:
            if bench.operator != self.origin:
                raise LiveError(f"{self.origin} only watches; take control first.")
            bench.commands.append((self.origin, what))
