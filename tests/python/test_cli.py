"""Claims about the command line: it loads little, works from a shell, and no mistake of a user ends in a traceback."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis.cli import bench
from tenodesis.cli.app import app, load
from tenodesis.cli.table import COMMANDS, Entry, EntryGroup
from tenodesis.errors import Error
from tenodesis.instrument import Instrument
from tenodesis.paper.context import Context
from tenodesis.paper.run import CHAPTERS
from tenodesis.report.content import Published

from .conftest import EXAMPLES, Command

HEAVY = ("typer", "matplotlib", "pint", "viser", "typst", "numpy", "scipy", "pydantic", "tenodesis.instrument")


def leaves() -> dict[str, Entry]:
    """Return all commands by the words that call them."""
    found: dict[str, Entry] = {}
    for name, command in COMMANDS.items():
        if isinstance(command, Entry):
            found[name] = command
            continue
        found |= {f"{name} {part}": own for part, own in command.commands.items()}
        if command.default is not None:
            found[f"{name} list"] = command.default
    return found


# ---------------------------------------------------------------------- what is loaded, and when


@pytest.mark.process
@pytest.mark.parametrize("arguments", [["--help"], ["export", "--help"], ["devices", "--help"]])
def test_an_overview_loads_no_library_of_the_commands(arguments: list[str]) -> None:
    code = (
        "import sys; from tenodesis.cli.commands import main\n"
        f"sys.argv = {['tenodesis', *arguments]!r}\n"
        "try: main()\n"
        "except SystemExit as end: assert not end.code\n"
        f"heavy = {set(HEAVY)!r} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
        "import tenodesis"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    names = [words.split()[-1] for words in leaves() if words.split()[:-1] == arguments[:-1]]
    assert all(name in done.stdout for name in names if name != "list")


@pytest.mark.parametrize("words", leaves())
def test_the_table_of_commands_says_what_their_docstrings_say(words: str) -> None:
    command = leaves()[words]
    assert str(load(command.function).__doc__).splitlines()[0] == command.help


def test_the_help_of_a_group_is_the_same_by_every_way(tenodesis: Command) -> None:
    fast = tenodesis("--help")[1]
    slow = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "140"}, prog_name="tenodesis").stdout
    assert fast.split() == slow.split()
    for name, command in COMMANDS.items():
        assert f" {name} " in fast
        if isinstance(command, EntryGroup):
            code, said, _ = tenodesis(name, "--help")
            assert code == 0
            assert f"tenodesis {name} [OPTIONS] COMMAND [ARGS]..." in said
            assert all(f" {part} " in said for part in command.commands)


@pytest.mark.parametrize("words", leaves())
def test_every_command_has_a_help_page(tenodesis: Command, words: str) -> None:
    code, said, wrong = tenodesis(*words.split(), "--help")
    assert (code, wrong) == (0, "")
    assert f"Usage: tenodesis {words}" in said


def test_a_command_that_is_not_there_is_answered_with_the_nearest(tenodesis: Command) -> None:
    code, _, wrong = tenodesis("benc")
    assert code == 2
    assert "No such command 'benc'. Did you mean 'bench'?" in wrong
    assert tenodesis()[0] == 2
    assert tenodesis("export")[0] == 2


@pytest.mark.parametrize(
    ("module", "extra", "words"),
    [
        ("viser", "live", ("console",)),
        ("serial", "devices", ("devices", "test", "scaled-up", "serial", "--address", "/dev/null")),
        ("typst", "design", ("scale", "real-size", "--combinations", "1000")),
        ("SALib", "design", ("tolerance", "real-size", "scaled-up", "--samples", "16")),
        ("pandas", "tables", ("export", "recording", "run.mcap", "--out", "run.parquet")),
    ],
)
def test_a_command_without_its_extra_says_what_to_install(
    tenodesis: Command, scaled: Instrument, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    module: str, extra: str, words: tuple[str, ...],
) -> None:  # fmt: skip
    for name in [name for name in sys.modules if name.startswith(("tenodesis.console", f"{module}."))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    with tn.Recorder(tmp_path / "run.mcap", axes=("yaw",)) as recorder:
        recorder.write(tn.twin.Twin(scaled).run([0.0] * 100))
    code, _, wrong = tenodesis(*words)
    assert code == 1
    assert f"tenodesis[{extra}]" in wrong
    assert len(wrong.strip().splitlines()) == 1


# ---------------------------------------------------------------------- the bench, schemas and instrument files


def test_bench_takes_any_instrument_file_and_shows_its_results(
    tenodesis: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Instrument, Instrument | None, Path]] = []

    def run(
        inst: Instrument, scaled: Instrument | None, out: Path, progress: Callable[[str], None], only: list[str]
    ) -> Context:
        asked.append((inst, scaled, out))
        progress("loss of angle")
        context = Context(inst, scaled, True)
        context.add("tension.slack_load", 3.21, "N", "load at which a tendon goes slack", Published(3.2, "Fig. 9"))
        return context

    monkeypatch.setattr(bench, "run", run)
    code, said, _ = tenodesis("bench", EXAMPLES / "pulley.toml", "--out", "elsewhere")
    assert code == 0
    assert asked == [(tn.load(EXAMPLES / "pulley.toml"), None, Path("elsewhere"))]
    assert "elsewhere/report.html" in said
    assert "tension.slack_load" in said
    assert "3.21 N" in said
    assert "3.2 N" in said
    assert tenodesis("bench")[0] == 0
    assert asked[1] == (tn.load("real-size"), tn.load("scaled-up"), Path("out"))


def test_bench_computes_the_chapters_that_are_named(
    tenodesis: Command, declined: Callable[..., Error], tmp_path: Path
) -> None:
    code, said, _ = tenodesis("bench", EXAMPLES / "pulley.toml", "--only", "loss, slack", "--only", "transmissibility")
    assert code == 0
    assert "published" not in said
    names = json.loads((tmp_path / "out/results.json").read_text("utf-8"))["results"]
    assert {key.partition(".")[0] for key in names} == {"loss", "tension", "transmissibility"}
    problem = declined("bench", EXAMPLES / "pulley.toml", "--only", "loss,los", "--out", "nowhere")
    assert (problem.key, problem.value) == ("--only", "los")
    assert not (tmp_path / "nowhere").exists()
    listed = tenodesis("bench", "--help")[1]
    assert all(re.search(rf"\b{name}\b", listed) for name in CHAPTERS if "-" not in name)


def test_bench_computes_all_joints_of_ones_own_two_axes_unless_one_is_named(
    tenodesis: Command, tmp_path: Path, declined: Callable[..., Error]
) -> None:
    own = (EXAMPLES / "pulley.toml").read_text("utf-8")
    own = own.replace('joint_type = "tendon-pulley"', 'joint_type = "tendon-pulley"\naxes = ["yaw", "pitch"]')
    (tmp_path / "own.toml").write_text(own, "utf-8")

    def joints(*options: str) -> set[str]:
        assert tenodesis("bench", "own.toml", "--only", "loss", "--overwrite", *options)[0] == 0
        names = json.loads((tmp_path / "out/results.json").read_text("utf-8"))["results"]
        return {joint for joint in ("yaw", "pitch") if any(f".{joint}." in name for name in names)}

    assert joints() == {"yaw", "pitch"}
    assert joints("--axis", "pitch") == set()
    assert declined("bench", "own.toml", "--scaled-up", "needle-driver").key == "scaled_up"


@pytest.mark.process
def test_the_command_line_runs_from_a_shell(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tenodesis.cli", "check", "absent"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=60, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("tenodesis: absent: there is no such file")
    assert "Traceback" not in done.stderr


def test_version_and_short_help_are_there_by_every_way(tenodesis: Command) -> None:
    assert tenodesis("--version")[:2] == (0, f"tenodesis {tn.__version__}\n")
    assert CliRunner().invoke(app, ["--version"]).stdout == f"tenodesis {tn.__version__}\n"
    assert tenodesis("-h")[1] == tenodesis("--help")[1]
    assert "Usage: tenodesis check" in tenodesis("check", "-h")[1]


def test_quiet_leaves_only_what_a_command_is_for(tenodesis: Command, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text('name = "short"\n[[phases]]\nkind = "hold"\nduration = "0.05 s"\n')
    words = ("record", "scaled-up", "short.toml", "--out", "x.mcap", "--overwrite")
    for quiet in ((*words, "--quiet"), (*words, "-q"), ("--quiet", *words)):
        code, said, wrong = tenodesis(*quiet)
        assert (code, wrong) == (0, "")
        assert [line.partition(":")[0] for line in said.splitlines()] == ["x.mcap", "tip", "tensions", "slack"]
    assert "No such" in tenodesis("record", "absent", "short.toml", "--quiet")[2].replace("there is no such", "No such")
    file = ("new", "mine", "--defaults", "--overwrite")
    assert "Next: tenodesis check" in tenodesis(*file)[1]
    assert "Next: " not in tenodesis(*file, "--quiet")[1]


@pytest.mark.parametrize(
    ("words", "expected"),
    [("rec", "record"), ("record --ove", "--overwrite"), ("export ", "urdf"), ("export urdf --o", "--out")],
)
def test_a_shell_completes_commands_and_options(words: str, expected: str) -> None:
    given = f"tenodesis {words}"
    place = len(given.split()) - (0 if given.endswith(" ") else 1)
    shell = {"_TENODESIS_COMPLETE": "complete_bash", "COMP_WORDS": given, "COMP_CWORD": str(place)}
    assert expected in CliRunner().invoke(app, [], env=shell, prog_name="tenodesis").stdout.split()
