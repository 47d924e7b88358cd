import gc
import importlib.util
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import tenodesis as tn
from tenodesis.errors import ArgumentError, Error, IdentificationError, ProtocolError
from tenodesis.instrument import Instrument

if TYPE_CHECKING:
    from tenodesis.console import Page
    from tenodesis.identification.formats.instrument_run import InstrumentRun

    from .console_stand_in import StandIn
    from .live_loop import LiveLoop

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "studies"


def load_study(name: str) -> ModuleType:
    """Return the module of a study, which is no part of a package and may import others."""
    if str(STUDIES) not in sys.path:
        sys.path.append(str(STUDIES))
    return load_file(STUDIES / f"{name}.py")


def load_file(path: Path) -> ModuleType:
    """Return the module of a file that is no part of a package."""
    spec = importlib.util.spec_from_file_location(f"{path.stem}_{path.parent.name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


EXAMPLES = ROOT / "examples"


def tables(inst: Instrument, key: str) -> list[dict[str, Any]]:
    """Return the tables of an instrument's joints or tendons, with the keys that its file has."""
    return [one.model_dump(exclude_unset=True, exclude_none=True) for one in inst.as_given(key)]


# No test depends on luck: the same examples every time, and no verdict by the clock.
settings.register_profile("repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def real() -> Instrument:
    return tn.load("real-size")


@pytest.fixture(scope="session")
def scaled() -> Instrument:
    return tn.load("scaled-up")


@pytest.fixture(scope="session")
def pulley() -> Instrument:
    return tn.load(EXAMPLES / "pulley.toml")


@pytest.fixture(scope="session")
def continuum() -> Instrument:
    return tn.load(EXAMPLES / "continuum.toml")


@pytest.fixture(params=["real", "scaled", "pulley", "continuum"])
def any_inst(request: pytest.FixtureRequest) -> Instrument:
    """Every mechanism, and both instruments of the paper."""
    inst: Instrument = request.getfixturevalue(request.param)
    return inst


PARTS = (IdentificationError, ProtocolError)
"""Errors whose sentences are often parts of longer ones."""


@contextmanager
def refused(
    key: str, value: Any = ..., kind: type[Error] = ArgumentError, allowed: str = ""
) -> Iterator[pytest.ExceptionInfo[Error]]:
    """Expect an error about this key and value, and with this in what it allows, whatever its wording."""
    with pytest.raises(kind) as caught:
        yield caught
    assert caught.value.key == key
    if value is not ...:
        np.testing.assert_equal(caught.value.value, value)
    assert allowed in caught.value.allowed
    assert kind in PARTS or str(caught.value).endswith(".")


def until(happens: Callable[[], Any], process: "subprocess.Popen[Any] | None" = None, seconds: float = 60.0) -> bool:
    """Wait until something happens, while a process runs, if one is given; it is an error if it does not."""
    end = time.monotonic() + seconds
    while not happens():
        assert process is None or process.poll() is None, "the process has ended"
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(0.01)
    return True


Ended: TypeAlias = tuple[int, str, str, BaseException | None]
Command: TypeAlias = Callable[..., tuple[int, str, str]]
"""Runs the command line; returns exit code, output and errors."""


@pytest.fixture
def ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Ended]:
    """Run the command line here, in a folder of its own; returns exit code, output, errors and the exception."""
    from tenodesis.cli import commands, common

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "140")
    monkeypatch.setattr(common.console, "width", 140)  # which has been read when the module was first imported

    def run(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["tenodesis", *map(str, arguments)])
        code, problem = 0, None
        try:
            commands.main()
        except SystemExit as end:
            code, problem = int(end.code or 0), end.__context__
        said = capsys.readouterr()
        return code, said.out, said.err, problem

    return run


@pytest.fixture
def tenodesis(ended: Callable[..., Ended]) -> Command:
    return lambda *arguments: ended(*arguments)[:3]


@pytest.fixture
def declined(ended: Callable[..., Ended]) -> Callable[..., Error]:
    """Run a command that must end in one sentence and exit code 1; returns the error."""

    def run(*arguments: object) -> Error:
        code, said, wrong, problem = ended(*arguments)
        assert (code, len(wrong.strip().splitlines())) == (1, 1), wrong
        assert not said or "--json" not in arguments
        assert isinstance(problem, Error)
        assert wrong == f"tenodesis: {problem}\n"
        return problem

    return run


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory, scaled: Instrument) -> Path:
    """A recording of the scaled-up instrument."""
    from tenodesis.recording.simulation import record

    from .recording_files import PROTOCOL

    path = tmp_path_factory.mktemp("formats") / "run.mcap"
    record(scaled, PROTOCOL, path, seed=2)
    return path


@pytest.fixture(scope="session")
def recorded(log: Path) -> "InstrumentRun":
    """That recording as it is read for identification."""
    from .recording_files import read

    return read(log)


@pytest.fixture
def loop(tmp_path: Path, scaled: Instrument) -> "LiveLoop":
    """A live loop without its thread, enabled and at rest."""
    from .live_loop import TURN, LiveLoop

    loop = LiveLoop(tmp_path, scaled)
    loop.ask("enable")
    loop.ticks(TURN)
    return loop


@pytest.fixture
def bench(scaled: Instrument, tmp_path: Path) -> "Iterator[StandIn]":
    """A stand-in for a runtime, for the console."""
    from .console_stand_in import StandIn

    found = StandIn(scaled, tmp_path)
    yield found
    found.close()


@pytest.fixture
def page(bench: "StandIn", tmp_path: Path) -> "Iterator[Page]":
    """The console's page on that stand-in."""
    from tenodesis.console import serve

    with serve(bench.connect, port=0, recordings=tmp_path) as served:
        yield served


def start_command(folder: Path, *words: str, python: tuple[str, ...] = ()) -> "subprocess.Popen[str]":
    """Return the running process of a command in a folder; `python` are options of the interpreter."""
    return subprocess.Popen(
        [sys.executable, *python, "-m", "tenodesis.cli", *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell lets its background jobs, these tests among them, ignore Ctrl-C, and they pass that on.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, so that no worker is left with one of them at the end."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow") or item.get_closest_marker("process"))
    longest = (
        "test_tolerance_cluster.py",
        "test_plants.py",
        "test_paper.py",
        "test_package.py",
        "test_paper_sections.py",
        "test_workshop.py",
        "test_consumers.py",
    )
    items.sort(key=lambda item: (item.path.name not in longest, -slow[item.path]))


def pytest_collection() -> None:
    gc.disable()


def pytest_collection_finish() -> None:
    """Search for garbage from now on, and never in what lives as long as the tests."""
    gc.freeze()
    gc.enable()
