"""A simulated bench on a CAN bus: the twin, stepped once per SYNC, behind simulated nodes."""

import threading
import time
from collections.abc import Callable
from math import isfinite, pi
from types import TracebackType
from typing import Protocol, Self

import can
import canopen
import numpy as np
from canopen import objectdictionary as od

from tenodesis.devices.can_layout import wired_by
from tenodesis.devices.device import Measurement
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanAngle, CanOpen, CanTension
from tenodesis.run import Array, Run
from tenodesis.twin import Twin

from .cia402 import Drive, Node

_TYPES = {
    "i8": od.INTEGER8,
    "u8": od.UNSIGNED8,
    "i16": od.INTEGER16,
    "u16": od.UNSIGNED16,
    "i32": od.INTEGER32,
    "u32": od.UNSIGNED32,
    "f32": od.REAL32,
}
_CIA_401 = 0x0004_0191
_IDLE = 1e-3  # s


class Plant(Protocol):
    """What the simulated drives turn, and the simulated sensors measure."""

    def step(self, spool_velocity: Array, spool_tension: Array | None = None) -> Measurement:
        """Go on by a sampling period with spool velocities (rad/s) or tensions (N); return what is measured."""


class TwinPlant:
    """The twin as a plant.

    `motion` gives handle angles and tip forces at a time (s), numbers or shape (axes,), or the wrench, (6,), where
    the instrument takes one; by default it rests.
    """

    def __init__(
        self, twin: Twin, motion: Callable[[float], tuple[float | Array, float | Array]] = lambda _: (0.0, 0.0)
    ) -> None:
        self.twin, self._motion = twin, motion
        self._steps = max(1, round(1 / (twin.inst.sensors.sampling_rate * twin.time_step)))
        self.latest: Run | None = None
        """The twin's steps of the last sampling period, truth included."""

    def step(self, spool_velocity: Array, spool_tension: Array | None = None) -> Measurement:
        """Go on by a sampling period."""
        names, shape = self.twin.names, spool_velocity.shape
        motion, load = self._motion(self.twin.time)
        handle = np.broadcast_to(motion, (self._steps, len(names.handle_joints)))
        by_axis = self.twin.inst.short_form is not None
        loaded = {"force": np.broadcast_to(load, handle.shape)} if by_axis else {"wrench": np.asarray(load)}
        held = {} if spool_tension is None else {"spool_tension": spool_tension.ravel()}
        self.latest = run = self.twin.run(handle, spool_velocity=spool_velocity.ravel(), **held, **loaded)  # type: ignore[arg-type]

        def measured(name: str) -> Array:
            values: Array = run.by_column(f"measured_{name}")[-1]
            return values

        return Measurement(
            round(self.twin.time * 1e9),
            measured("handle_angle"),
            measured("tension").reshape(shape),
            measured("spool_angle").reshape(shape),
            measured("output_angle"),
        )


class SimulatedBench:
    """The nodes of an instrument's table devices.canopen, served on an open bus by a thread of their own.

    Lock-step: with every SYNC the plant, by default a twin, goes on by a sampling period with the speeds that were in
    force since the SYNC before, the nodes send what is then measured, and speeds that have come since take force.
    Heartbeats are timed by the clock (ns); drives' encoders show `positions` at first, counts by node.
    """

    def __init__(
        self,
        inst: Instrument,
        settings: CanOpen,
        bus: can.BusABC,
        *,
        plant: Plant | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        positions: dict[int, int] | None = None,
    ) -> None:
        self.inst, self.settings, self.bus = inst, settings, bus
        self.plant: Plant = TwinPlant(Twin(inst)) if plant is None else plant
        self.network = _Network(bus)
        self._wiring = wired_by(inst, settings)
        self._unit = settings.velocity_unit or 2 * pi / inst.drives.encoder_counts
        objects: dict[int, list[tuple[int, int, int]]] = {}
        for source in (plug.part for plug in self._wiring.sensors):
            objects.setdefault(source.node, []).append((source.object, source.sub, _TYPES[source.type]))
        counter = settings.counter
        self.drives = {
            drive.node: Drive(
                drive.node,
                self.network,
                clock,
                counter=None if counter is None else (counter.object, counter.sub),
                position=(positions or {}).get(drive.node, 0),
                objects=objects.pop(drive.node, []),
            )
            for drive in (plug.part for plug in self._wiring.drives)
        }
        self.nodes: dict[int, Node] = dict(self.drives)
        self.nodes |= {number: Node(number, _CIA_401, self.network, clock, own) for number, own in objects.items()}
        self.network.subscribe(0x80, self._sync)
        self.network.subscribe(0, self._commanded)
        self.syncs = 0
        """How many were answered."""
        self.velocity = np.zeros(self._wiring.spools)
        """Spool velocities in force, rad/s."""
        self.tension = np.zeros(self._wiring.spools)
        """Tensions that drives hold by their torques, N; 0: a drive follows its speed."""
        self.fastest = 0.0
        """Largest of them so far."""
        self.fixed: dict[tuple[int, int, int], float] = {}
        """Raw values by node, index and sub-index that stand in for what is measured."""
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="simulated bench", daemon=True)
        self._problem: BaseException | None = None
        for drive in self.drives.values():
            drive.measure(0)

    @property
    def mangle(self) -> Callable[[int, bytes], bytes | None]:
        """What becomes of a frame that a node sends: None is none."""
        return self.network.mangle

    @mangle.setter
    def mangle(self, mangle: Callable[[int, bytes], bytes | None]) -> None:
        self.network.mangle = mangle

    @property
    def running(self) -> bool:
        """Whether it serves."""
        return self._thread.is_alive()

    def cut_off(self, node: int) -> None:
        """Pull a node's cable."""
        self.nodes[node].cut_off = True
        self.network.cut_off.add(node)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End; what has failed in the bench is raised here."""
        self._ending.set()
        self._thread.join()
        if self._problem is not None:
            raise self._problem

    def _serve(self) -> None:
        try:
            while not self._ending.is_set():
                message = self.bus.recv(_IDLE)
                if message is not None and not (message.is_error_frame or message.is_remote_frame):
                    self.network.notify(message.arbitration_id, message.data, message.timestamp)
                for node in self.nodes.values():
                    node.poll()
                self._rule()
        except BaseException as problem:
            self._problem = problem

    def _commanded(self, can_id: int, data: bytearray, timestamp: float) -> None:
        for node in self.nodes.values():
            if len(data) == 2 and data[0] == 1 and data[1] in (0, node.number):
                node.started()

    def _sync(self, can_id: int, data: bytearray, timestamp: float) -> None:
        measured = self.plant.step(self.velocity, *([self.tension] if self.settings.tension_drives else []))
        per_count = 2 * pi / self.inst.drives.encoder_counts / self.inst.drives.gear_ratio
        for plug in self._wiring.drives:
            turned = round(measured.spool_angle.flat[plug.place] / per_count)
            self.drives[plug.part.node].measure(-turned if plug.part.reversed else turned)
        values = np.concatenate([measured.handle_angle, measured.tension.ravel(), measured.output_angle])
        for plug in self._wiring.sensors:
            self._set(plug.part, float(values[plug.place]))
        for (number, index, sub), raw in self.fixed.items():
            self.nodes[number].set(index, sub, raw)
        for node in self.nodes.values():
            if node.operational:
                node.send_pdos()
        for drive in self.drives.values():
            if drive.operational:
                drive.act()
        self._rule()
        self.syncs += 1

    def _set(self, source: CanAngle | CanTension, value: float) -> None:
        raw = (value - source.offset) / source.gain
        self.nodes[source.node].set(source.object, source.sub, raw if isfinite(raw) or source.type == "f32" else 0)

    def _rule(self) -> None:
        """Take over the speeds in force."""
        for plug in self._wiring.drives:
            drive, gears = self.drives[plug.part.node], self.inst.drives
            follows = drive.pursuit(self.inst.sensors.sampling_rate) * 2 * pi / gears.encoder_counts
            speed = (drive.velocity * self._unit + follows) / gears.gear_ratio
            self.velocity.flat[plug.place] = -speed if plug.part.reversed else speed
            pull = -drive.pull if plug.part.reversed else drive.pull
            torque = pull / 1000 * (self.settings.rated_torque or 0.0)
            force = gears.gear_ratio * gears.gear_efficiency / self.inst.own_drives.spool_radius
            self.tension.flat[plug.place] = torque * force
        self.fastest = max(self.fastest, float(np.abs(self.velocity).max()))


class _Network(canopen.Network):
    """The library's network, with frames that can be changed and nodes that can be cut off."""

    def __init__(self, bus: can.BusABC) -> None:
        super().__init__(bus)
        self.mangle: Callable[[int, bytes], bytes | None] = lambda _, data: data
        self.cut_off: set[int] = set()

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        if can_id & 0x7F in self.cut_off:
            return
        mangled = self.mangle(can_id, bytes(data))
        if mangled is not None:
            super().send_message(can_id, mangled, remote)

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> "_NoTask":  # type: ignore[override]
        """Send nothing: the nodes here keep their heartbeats' time themselves."""
        return _NoTask()


class _NoTask:
    def stop(self) -> None:
        pass

    def update(self, data: bytes) -> None:
        pass
