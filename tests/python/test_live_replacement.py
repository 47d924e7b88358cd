"""Claims about replacing a runtime: the one that runs goes on until another does, and a stop always finds motors."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import tenodesis as tn
from tenodesis import plant
from tenodesis.cli import live
from tenodesis.cli.instrument import check
from tenodesis.errors import InstrumentError, LiveError
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders
from tenodesis.live import host as hosts
from tenodesis.live.host import Host, HostConnection
from tenodesis.live.runtime_process import RuntimeProcess

from .conftest import refused, until

UNRUNNABLE = [
    ("dynamics.tip_inertia", "1e-7 kg*m^2"),
    ("sensors.sampling_rate", "1e-9 Hz"),
    ("sensors.sampling_rate", "30 Hz"),
    ("sensors.sampling_rate", "1500 Hz"),
    ("control.watchdog", "0.1 ms"),
]


@pytest.mark.parametrize(("key", "value"), UNRUNNABLE)
def test_a_file_that_cannot_run_says_which_value_prevents_it(
    scaled: Instrument, tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str, value: str
) -> None:
    inst = scaled.replace(**{key: value})
    with refused(key, kind=InstrumentError) as caught:
        plant.check_runnable(inst)
    assert caught.value.allowed
    file = tmp_path / "bad.toml"
    file.write_text(to_toml(inst))
    check(str(file))
    assert str(caught.value) in capsys.readouterr().out


def test_a_sampling_period_of_years_is_refused_by_a_twin_too(scaled: Instrument) -> None:
    with refused("sensors.sampling_rate"):
        tn.twin.Twin(scaled.replace(**{"sensors.sampling_rate": "1e-9 Hz"}))


@contextmanager
def operating(link: HostConnection) -> Iterator[None]:
    """Renew the lease meanwhile, as the page does."""
    done = threading.Event()

    def beat() -> None:
        while not done.wait(0.2):
            link.heartbeat()

    beating = threading.Thread(target=beat)
    beating.start()
    try:
        yield
    finally:
        done.set()
        beating.join()


@pytest.fixture
def host(tmp_path: Path) -> Iterator[Host]:
    made = Host("scaled-up", recordings=tmp_path)
    yield made
    made.close()


@contextmanager
def enabled(host: Host) -> Iterator[HostConnection]:
    """A connection that operates enabled motors."""
    link = host.connect("one")

    def is_enabled() -> bool:
        # Again, where a busy machine has let the lease run out meanwhile.
        assert link.acquire()
        link.request("enable")
        return link.status().state == "ENABLED"

    until(is_enabled)
    with operating(link):
        yield link


@pytest.mark.process
@pytest.mark.parametrize(("key", "value"), UNRUNNABLE[:2])
def test_an_instrument_that_cannot_run_leaves_the_present_runtime_as_it_is(
    host: Host, scaled: Instrument, key: str, value: str
) -> None:
    with enabled(host) as link:
        pid = host.pid
        with refused(key, kind=InstrumentError):
            link.load(to_toml(scaled.replace(**{key: value})))
        assert host.pid == pid
        assert link.status().state == "ENABLED"
        assert link.inst == scaled


@pytest.mark.process
def test_a_runtime_that_does_not_start_leaves_the_present_one_as_it_is(
    host: Host, scaled: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What no check finds: the new process cannot begin.
    monkeypatch.setattr(hosts, "rehearse", lambda *_: None)
    with enabled(host) as link:
        with pytest.raises(LiveError, match="sampling_rate"):
            link.load(to_toml(scaled.replace(**{"sensors.sampling_rate": "1e-9 Hz"})))
        assert link.status().state == "ENABLED"
        link.load("real-size")
        assert link.inst.name == "real-size"
        assert link.heartbeat()


@pytest.mark.process
def test_a_bench_that_is_opened_only_once_gets_its_instrument_back(
    host: Host, scaled: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hosts, "rehearse", lambda *_: None)
    monkeypatch.setattr(hosts, "_exists_once", lambda _: True)
    with enabled(host) as link:
        with pytest.raises(LiveError, match="runs again, its motors disabled"):
            link.load(to_toml(scaled.replace(**{"sensors.sampling_rate": "1e-9 Hz"})))
        assert link.inst == scaled
        assert link.status().state == "DISABLED"


@pytest.mark.process
def test_a_stop_is_never_without_an_answer_while_runtimes_are_replaced(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hosts, "_exists_once", lambda _: True)
    answered, failed = [], []

    def press() -> None:
        while not done.is_set():
            try:
                link.stop_for("stop button")
            except LiveError as problem:
                failed.append((host.pid, str(problem)))
            else:
                answered.append(host.generation)
            time.sleep(0.05)

    done, pressing = threading.Event(), threading.Thread(target=press)
    with enabled(host) as link:
        pressing.start()
        link.load("real-size")
        time.sleep(0.2)
        done.set()
        pressing.join()
        assert {1, 2} <= set(answered)
        assert failed == []
        assert link.status().stopped


@pytest.mark.process
def test_a_runtime_that_hangs_is_stopped_by_ending_it(host: Host) -> None:
    with enabled(host) as link:
        pass
    assert host.pid is not None
    process: RuntimeProcess = host._process  # type: ignore[assignment]
    os.kill(host.pid, signal.SIGSTOP)
    begun = time.monotonic()
    link.stop()
    assert time.monotonic() - begun < 5
    assert not process.runs
    with pytest.raises(LiveError, match="has ended"):
        link.stop()


@pytest.mark.process
def test_the_link_of_the_page_is_printed_again(
    host: Host, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(live, "running", lambda: host.folder)
    with refused("FOLDER", kind=LiveError, allowed="of a live instrument with a page"):
        live.link()
    folders.write_link(host.home, "http://127.0.0.1:1/?token=x", "")
    live.link()
    assert capsys.readouterr().out == "http://127.0.0.1:1/?token=x\n"
