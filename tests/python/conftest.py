import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"


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


@pytest.fixture
def tenodesis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run the command line in this process, in a folder of its own; returns exit code, output and errors."""
    from tenodesis.cli import commands

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "140")

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["tenodesis", *map(str, arguments)])
        code = 0
        try:
            commands.main()
        except SystemExit as end:
            code = int(end.code or 0)
        said = capsys.readouterr()
        return code, said.out, said.err

    return run
