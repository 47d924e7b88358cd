"""Claims about the command line: it works from a shell, and nothing a user can mend ends in a traceback."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tenodesis.cli import commands
from tenodesis.instrument import Instrument, load
from tenodesis.paper.context import Context

from .conftest import EXAMPLES


def tenodesis(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tenodesis.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=300, check=False)


def test_bench_takes_any_instrument_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[Instrument, Instrument | None, Path]] = []

    def told(inst: Instrument, scaled: Instrument | None, out: Path, _: object) -> Context:
        asked.append((inst, scaled, out))
        return Context(inst, scaled, False)

    monkeypatch.setattr(commands, "bench_run", told)
    done = CliRunner().invoke(commands.app, ["bench", str(EXAMPLES / "pulley.toml"), "--out", f"{tmp_path}/elsewhere"])
    assert done.exit_code == 0, done.output
    assert asked == [(load(EXAMPLES / "pulley.toml"), None, tmp_path / "elsewhere")]


def test_schema_prints_json(tmp_path: Path) -> None:
    assert json.loads(tenodesis("schema", cwd=tmp_path).stdout)["title"] == "Tenodesis instrument"


def test_check_prints_values_and_sources(tmp_path: Path) -> None:
    done = tenodesis("check", "scaled-up", cwd=tmp_path)
    assert done.returncode == 0
    assert "11451" in done.stdout
    assert "Table I" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("bench", "absent.toml"), "tenodesis: absent.toml: there is no such file"),
        (("bench", "bad.toml"), "tenodesis: bad.toml: joint_type is missing; allowed are"),
        (("check", "bad.toml"), "tenodesis: bad.toml: joint_type is missing"),
        (("bench", "real-size", "--scaled-up", "absent"), "tenodesis: absent: there is no such file"),
        (("bench", "real-size", "--scaled-up", EXAMPLES / "pulley.toml"), "allowed is a scale model of the same joint"),
        (("bench", EXAMPLES / "pulley.toml", "--out", "bad.toml/out"), "bad.toml/out cannot be written"),
    ],
)
def test_a_mistake_ends_in_one_sentence(tmp_path: Path, arguments: tuple[object, ...], sentence: str) -> None:
    (tmp_path / "bad.toml").write_text('name = "x"\n')
    done = tenodesis(*arguments, cwd=tmp_path)
    assert done.returncode == 1
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
