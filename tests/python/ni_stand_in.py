"""A stand-in for the NI driver: it checks the calls that it is given, and keeps them."""

import inspect
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from tenodesis.devices.nidaq import NiTasks
from tenodesis.instrument.devices import NiDaq
from tenodesis.run import Array


def checked(kind: Any, name: str, effect: Callable[..., Any] = lambda *_, **__: None) -> MagicMock:
    """A method of the package nidaqmx that refuses arguments which the real one does not have."""
    signature = inspect.signature(getattr(kind, name))

    def call(*arguments: Any, **named: Any) -> Any:
        signature.bind(None, *arguments, **named)
        return effect(*arguments, **named)

    return MagicMock(side_effect=call)


class FakeNi:
    """The package nidaqmx with its own signatures, and no device behind them."""

    def __init__(self, *, watchdog: bool = True) -> None:
        nidaqmx = pytest.importorskip("nidaqmx")
        readers = pytest.importorskip("nidaqmx.stream_readers")
        writers = pytest.importorskip("nidaqmx.stream_writers")
        for part in ("system", "types"):
            pytest.importorskip(f"nidaqmx.{part}")
        from nidaqmx.task import collections
        from nidaqmx.task._timing import Timing

        self.constants, self.errors, self.types = nidaqmx.constants, nidaqmx.errors, nidaqmx.types
        self.tasks: list[Any] = []
        self.written: list[Array] = []
        self.at_once: list[list[float]] = []
        self.log: list[str] = []
        self.late = False
        self.stuck: int | None = None
        """Task that does not close at once."""
        self.unwritable = False

        def close(number: int) -> None:
            self.log.append(f"close {number}")
            if number == self.stuck:
                raise nidaqmx.errors.DaqError("it hangs", -50150)

        def write(data: list[float], auto_start: bool = False) -> None:
            if self.unwritable:
                raise nidaqmx.errors.DaqError("it is gone", -201003)
            self.at_once.append(data)

        def task() -> Any:
            number = len(self.tasks)
            made = SimpleNamespace(
                timing=SimpleNamespace(cfg_samp_clk_timing=checked(Timing, "cfg_samp_clk_timing")),
                in_stream=SimpleNamespace(avail_samp_per_chan=2),
                out_stream=SimpleNamespace(),
                start=checked(nidaqmx.Task, "start", lambda: self.log.append(f"start {number}")),
                close=checked(nidaqmx.Task, "close", lambda: close(number)),
                write=checked(nidaqmx.Task, "write", write),
            )
            for kind, collection, add in (
                ("ai", collections.AIChannelCollection, "add_ai_voltage_chan"),
                ("ao", collections.AOChannelCollection, "add_ao_voltage_chan"),
                ("ci", collections.CIChannelCollection, "add_ci_ang_encoder_chan"),
                ("do", collections.DOChannelCollection, "add_do_chan"),
            ):
                setattr(made, f"{kind}_channels", SimpleNamespace(**{add: checked(collection, add)}))
            self.tasks.append(made)
            return made

        def fill(data: Array, number_of_samples_per_channel: int = -1, timeout: float = 10.0) -> None:
            if self.late:
                raise nidaqmx.errors.DaqReadError("late", -200284, 0)
            data[:] = 1.5

        def keep(data: Array, timeout: float = 10.0) -> None:
            self.written.append(data.copy())

        self.write = checked(writers.AnalogMultiChannelWriter, "write_many_sample", keep)
        reader = SimpleNamespace(read_many_sample=checked(readers.AnalogMultiChannelReader, "read_many_sample", fill))
        counter = SimpleNamespace(
            read_many_sample_double=checked(readers.CounterReader, "read_many_sample_double", fill)
        )
        writer = SimpleNamespace(write_many_sample=self.write)
        self.Task = task
        self.stream_readers = SimpleNamespace(
            AnalogMultiChannelReader=checked(readers.AnalogMultiChannelReader, "__init__", lambda _: reader),
            CounterReader=checked(readers.CounterReader, "__init__", lambda _: counter),
        )
        self.stream_writers = SimpleNamespace(
            AnalogMultiChannelWriter=checked(writers.AnalogMultiChannelWriter, "__init__", lambda _, auto_start: writer)
        )
        kind = nidaqmx.system.WatchdogTask
        states = ("cfg_watchdog_ao_expir_states", "cfg_watchdog_do_expir_states")
        methods = (*states, "control", "stop", "close", "reset_timer")
        self.watchdog = SimpleNamespace(**{name: checked(kind, name) for name in methods})
        self.watchdog.start = checked(kind, "start", lambda: self.log.append("start watchdog"))

        def armed(device_name: str, timeout: float) -> Any:
            if not watchdog:
                raise nidaqmx.errors.DaqError("it has none", -200077)
            return self.watchdog

        devices = SimpleNamespace(devices=SimpleNamespace(device_names=["Dev1", "Dev2"]))
        self.system = SimpleNamespace(
            WatchdogTask=checked(kind, "__init__", armed), System=SimpleNamespace(local=lambda: devices)
        )


def ni_tasks(settings: NiDaq, ni: FakeNi, **changes: Any) -> NiTasks:
    settings = settings.model_copy(update=changes)
    assert settings.yaw is not None
    return NiTasks(
        settings,
        [one.channel for one in settings.yaw.sources.values()],
        settings.yaw.drives,
        rate=2000.0,
        encoder_counts=4096,
        ni=ni,
    )
