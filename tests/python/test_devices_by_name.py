"""Benches of instruments that list joints and tendons: drives and sensors are wired by their names."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.devices import registry
from tenodesis.devices.can_layout import wired_by
from tenodesis.devices.canopen import CanOpenDevice
from tenodesis.devices.device import Capabilities, Device, Measurement
from tenodesis.devices.nidaq import _current
from tenodesis.devices.wiring import wiring
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.instrument import FullForm
from tenodesis.instrument.devices import CanOpen, NiDaq
from tenodesis.instrument.text import to_toml
from tenodesis.live.ticks import Reader
from tenodesis.run import Array
from tenodesis.twin import Twin

from . import can_bench
from .can_bench import RATE, TIMEOUT, served
from .conftest import refused, until
from .simulated_bench.bench import TwinPlant
from .test_live import looped

pytest.importorskip("can")
pytest.importorskip("canopen")


def rated(name: str) -> FullForm:
    """Return a shipped instrument at the tests' rate."""
    inst = tn.load(name).replace(**{"sensors.sampling_rate": RATE})
    assert isinstance(inst, FullForm)
    return inst


def canopen_values(inst: FullForm) -> dict[str, Any]:
    """Return the table of a bench with a drive at each tendon and all sensors at one node."""
    angle = inst.sensors.encoder_range / 2**inst.sensors.encoder_bits
    tension = 2 * inst.sensors.load_cell_range / 2**inst.sensors.load_cell_bits
    subs = iter(range(1, 100))

    def source(gain: float) -> dict[str, Any]:
        return {"node": 20, "object": 0x6401, "sub": next(subs), "gain": gain}

    return {
        "tendons": {
            one.name: {"node": n, "reversed": n % 2 == 0, "tension": source(tension)}
            for n, one in enumerate(inst.tendons, 1)
        },
        "handle_joints": {one.name: source(angle) for one in inst.handle_joints},
        "joints": {one.name: source(angle) for one in inst.tip_joints},
    }


def canopen_table(inst: FullForm, **changes: Any) -> CanOpen:
    values = {
        "interface": "virtual",
        "channel": next(can_bench._channels),
        "velocity_unit": can_bench.SPEED_UNIT,
        "heartbeat": can_bench.HEARTBEAT,
    }
    return CanOpen.model_validate(values | canopen_values(inst) | changes)


@pytest.mark.parametrize("name", ["needle-driver", "hybrid-scaled-up"])
def test_each_motor_winds_its_tendon_and_each_sensor_measures_its_own(name: str) -> None:
    inst = rated(name)
    plant = TwinPlant(Twin(inst), lambda _: (0.1, np.zeros(6)))
    with served(inst, canopen_table(inst), plant=plant) as (device, bench, clock):
        has = device.capabilities
        assert has.tendons == tuple(one.name for one in inst.tendons)
        assert has.axes == tuple(one.name for one in inst.tip_joints)
        assert has.distal_encoder
        wanted = 0.02 * np.arange(1, len(inst.tendons) + 1)
        measured: Measurement | None = None
        for _ in range(60):
            clock.pass_time(1 / RATE)
            measured = device.read(TIMEOUT)
            device.write(wanted)
        assert bench.velocity == pytest.approx(wanted, abs=2 * can_bench.SPEED_UNIT)
        assert measured is not None
        run = plant.latest
        assert run is not None
        assert measured.tension == pytest.approx(run["measured_tension"][-1], abs=0.1)
        assert measured.spool_angle == pytest.approx(run["measured_spool_angle"][-1], abs=1e-3)
        assert measured.output_angle == pytest.approx(run["measured_output_angle"][-1], abs=1e-3)
        assert measured.handle_angle == pytest.approx(run.by_column("measured_handle_angle")[-1], abs=1e-3)


class TwinBench(Device):
    """A device that Python serves: the twin of an instrument, by the names of its tendons."""

    def __init__(self, inst: FullForm, break_sensor: float = np.inf) -> None:
        self._plant, self._breaks = TwinPlant(Twin(inst), lambda _: (0.0, np.zeros(6))), break_sensor
        self._speed = np.zeros(len(inst.tendons))
        names = self._plant.twin.names
        self.capabilities = Capabilities("bench", names.joints, RATE, True, False, True, 1 / RATE, 0.1, names.tendons)

    def open(self) -> None:
        pass

    def read(self, timeout: float) -> Measurement | None:
        time.sleep(1 / RATE)
        measured = self._plant.step(self._speed)
        if measured.time > self._breaks * 1e9:
            measured.tension[0] = np.nan
        return measured

    def write(self, spool_velocity: Array) -> None:
        assert spool_velocity.shape == self._speed.shape
        self._speed = spool_velocity.copy()

    def close(self) -> None:
        self._speed[:] = 0


@pytest.mark.process
def test_a_bench_by_name_is_driven_by_the_live_loop_and_stopped_where_a_sensor_fails(tmp_path: Path) -> None:
    inst = rated("needle-driver")
    bench = TwinBench(inst)
    loop = looped(tmp_path, inst, device=bench)
    reader = Reader(tmp_path)
    loop.start()
    try:
        loop.request("enable")
        until(lambda: reader.newest() is not None and reader.layout.signals_of(reader.newest())["state"] == 1)
        loop.hand([0.2, 0.1, -0.1])
        until(lambda: abs(reader.layout.signals_of(reader.newest())["measured_output_angle"][0] - 0.2) < 0.03)
        run, _ = reader.read(100_000)
        assert run.tendons == tuple(one.name for one in inst.tendons)
        assert run.commanded_spool_velocity is not None
        assert run.tension is None, "only a twin knows it"
        bench._breaks = 0.0
        until(lambda: loop.problem is not None)
        assert "had no value" in str(loop.problem)
        until(lambda: not bench._speed.any())
    finally:
        loop.finish()


def without(values: Mapping[str, Any], group: str, name: str) -> dict[str, Any]:
    return {**values, group: {key: value for key, value in values[group].items() if key != name}}


def test_what_is_missing_or_not_there_is_named() -> None:
    inst = rated("hybrid-scaled-up")
    values = canopen_values(inst)
    for group, name in (("tendons", "grip"), ("handle_joints", "trigger")):
        with pytest.raises(InstrumentError, match=rf"devices\.canopen\.{group}\.{name} is missing; hybrid"):
            wired_by(inst, CanOpen.model_validate(without(values, group, name)))
    more = {**values, "joints": {**values["joints"], "elbow": values["joints"]["jaw"] | {"sub": 99}}}
    with pytest.raises(InstrumentError, match="joints is 'elbow'; it must be among yaw, pitch, jaw"):
        wired_by(inst, CanOpen.model_validate(more))
    assert not wired_by(inst, CanOpen.model_validate(without(values, "joints", "jaw"))).distal
    with pytest.raises(ValueError, match="nor tendons; give one table"):
        CanOpen.model_validate({})


def test_the_file_of_an_instrument_keeps_its_wiring() -> None:
    inst = rated("needle-driver").replace(devices={"canopen": canopen_table(rated("needle-driver")).model_dump()})
    again = tn.parse(to_toml(inst))
    assert again.devices.canopen == inst.devices.canopen
    device = registry.make("canopen", again)
    assert isinstance(device, CanOpenDevice)
    with refused("inst", kind=DeviceError):
        registry.make("serial", again)


def test_channels_of_a_data_acquisition_device_are_wired_by_name() -> None:
    inst = rated("two-segment-continuum")
    tendons = {
        one.name: {"speed": f"ao{n}", "gain": 10.0, "counter": f"ctr{n}", "tension": {"channel": f"ai{n}", "gain": 5.0}}
        for n, one in enumerate(inst.tendons)
    }
    settings = NiDaq.model_validate({"tendons": tendons})
    plan = wiring(inst, settings, "nidaq", _current)
    assert [plug.part.speed for plug in plan.drives] == ["ao0", "ao1", "ao2", "ao3"]
    assert [plug.place for plug in plan.sensors] == [0, 1, 2, 3]
    assert not plan.distal
    tendons["far_agonist"]["speed"] = "ao0"
    with pytest.raises(ValueError, match="'ao0' is given twice"):
        NiDaq.model_validate({"tendons": tendons})


def test_currents_of_the_drives_measure_the_tensions_where_the_file_says_so() -> None:
    inst = rated("needle-driver").replace(
        **{"sensors.kind": "current", "sensors.current_range": 3.0, "drives.torque_constant": 0.05}
    )
    values = canopen_values(rated("needle-driver"))
    drives = {name: {"node": one["node"], "reversed": one["reversed"]} for name, one in values["tendons"].items()}
    settings = CanOpen.model_validate({**values, "tendons": drives, "rated_current": 3.0})
    plan = wired_by(inst, settings)
    tensions = plan.sensors[: len(inst.tendons)]
    assert [plug.of for plug in tensions] == [one.name for one in inst.tendons]
    assert {plug.part.object for plug in tensions} == {0x6078}
    per_count = inst.tension_sensors[0].per_current * 3.0 / 1000
    assert [plug.part.gain for plug in tensions[:2]] == pytest.approx([per_count, -per_count])
    with refused("devices.nidaq.tendons.pitch_wound.current", kind=InstrumentError):
        inst.replace(devices={"nidaq": {"tendons": {"pitch_wound": {"speed": "ao0", "gain": 1.0, "counter": "c"}}}})
    with refused("devices.nidaq.tendons.pitch_wound.tension", kind=InstrumentError):
        rated("needle-driver").replace(
            devices={"nidaq": {"tendons": {"pitch_wound": {"speed": "ao0", "gain": 1.0, "counter": "c"}}}}
        )
