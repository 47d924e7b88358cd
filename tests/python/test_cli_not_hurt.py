"""Claims about mistakes at the command line: each ends in one sentence, before any work, and nothing is lost."""

import os
import shlex
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

import tenodesis as tn
from tenodesis.files import locked_file, locked_folder
from tenodesis.recording.simulation import write_run

from .conftest import EXAMPLES, ROOT, Command, start_command, until

SHORT = 'name = "short"\n[[phases]]\nkind = "hold"\nduration = "0.05 s"\n'
PROTOTYPE = ("scaled-up.toml", "plan.html", "plan.pdf", "parts.csv", "front.csv", "front.svg", "front.png")
TOLERANCE = ("tolerance.html", "tolerance.json", "samples.csv", "figures/tornado.svg")
VERTICES = ("vertices.html", "results.json", "sweep.csv", "figures/vertices.svg")
PLAN = ("protocol.toml", "plan.html", "plan.svg", "plan.json")
FIT = ("report.html", "result.json", "instrument.toml")
BENCH = ("report.html", "results.json", "figures/loss.svg", "curves/mine.csv", "recordings/mine.mcap")
IDENTIFY = "identify run.mcap"
TWO = "tolerance real-size scaled-up"


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    inst = tn.load("scaled-up")
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    write_run(tn.twin.Twin(inst).run([0.0] * 200), inst, path)
    return path


@pytest.fixture
def desk(tmp_path: Path, recording: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a file of every kind; work of any length fails the test."""
    from tenodesis.cli import bench, identify, plan_identification, scale, tolerance, vertices
    from tenodesis.recording import replay as replays
    from tenodesis.recording import simulation

    for module, name in (
        (bench, "run"),
        (identify, "fit"),
        (plan_identification, "plan"),
        (scale.scaling, "design"),
        (tolerance, "write"),
        (vertices, "write"),
        (simulation, "record"),
        (replays, "_run"),
    ):
        monkeypatch.setattr(module, name, lambda *_, **__: pytest.fail("worked before it asked"))
    shutil.copy(recording, tmp_path / "run.mcap")
    shutil.copy(recording, tmp_path / "run.csv")  # a recording by another name
    shutil.copy(ROOT / "instruments/scaled-up.toml", tmp_path / "own.toml")
    for name in ("own.h", "own.urdf", "own.mcap"):
        shutil.copy(ROOT / "instruments/scaled-up.toml", tmp_path / name)
    shutil.copy(EXAMPLES / "pulley.toml", tmp_path / "pulley.toml")
    (tmp_path / "short.toml").write_text(SHORT)
    (tmp_path / "short.mcap").write_text(SHORT)
    (tmp_path / "parts.toml").write_text('[[ropes]]\nname = "cord"\n')
    (tmp_path / "widths.toml").write_text('[[parameters]]\nkey = "pretension"\n')
    (tmp_path / "notes.txt").write_text("mine\n")
    (tmp_path / "data.csv").write_text("time [s]\n0\n")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.mcap").mkdir()
    return tmp_path


def contents(folder: Path) -> dict[str, bytes | None]:
    """Return the bytes of all files below a folder, by path; None for a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def refused(tenodesis: Command, desk: Path, words: str, sentence: str) -> None:
    """Run a command that must be refused in a sentence, and leave everything as it was."""
    before = contents(desk)
    code, _, wrong = tenodesis(*words.split())
    assert code != 0
    assert sentence in " ".join(wrong.split())
    assert "Traceback" not in wrong
    if code == 1:
        assert wrong.startswith("tenodesis: ")
        assert len(wrong.strip().splitlines()) == 1
        assert wrong.strip().endswith(".")
    assert contents(desk) == before


EXISTING = [
    *(("bench pulley.toml --out there", f"there/{name}") for name in BENCH),
    *(("scale real-size --combinations 1000", f"prototype/{name}") for name in PROTOTYPE),
    *((f"{TWO} --out there", f"there/{name}") for name in TOLERANCE),
    *(("vertices --out there", f"there/{name}") for name in VERTICES),
    *((f"{IDENTIFY} --out there", f"there/{name}") for name in FIT),
    (f"{IDENTIFY} --json-out there.json", "there.json"),
    *(("plan-identification scaled-up --out there", f"there/{name}") for name in PLAN),
    ("record scaled-up short.toml --out there.mcap", "there.mcap"),
    ("record scaled-up cycles", "recordings/cycles-scaled-up.mcap"),
    ("replay run.mcap --out there.mcap", "there.mcap"),
    ("replay run.mcap --plot-out there.svg", "there.svg"),
    ("transfer real-size run.mcap", "run-real-size.mcap"),
    ("transfer real-size run.mcap --instrument-out there.toml", "there.toml"),
    ("export recording run.mcap --out there.csv", "there.csv"),
    ("export recording run.mcap --out there.parquet", "there.parquet"),
    ("export recording own.mcap", "own.csv"),
    ("export controller scaled-up", "scaled_up.h"),
    ("export controller scaled-up --out there.h", "there.h"),
    ("export urdf scaled-up", "scaled-up.urdf"),
    ("export mjcf scaled-up --out there.xml", "there.xml"),
    ("new mine --defaults", "mine.toml"),
]


@pytest.mark.parametrize(("words", "existing"), EXISTING)
def test_nothing_is_overwritten_unasked(tenodesis: Command, desk: Path, words: str, existing: str) -> None:
    (desk / existing).parent.mkdir(parents=True, exist_ok=True)
    (desk / existing).write_text("the work of a year")
    refused(tenodesis, desk, words, "exists already; give another path, or --overwrite.")


@pytest.mark.parametrize(
    ("words", "key"), [("bench pulley.toml", "results"), (TWO, "responses"), ("vertices", "designs")]
)
def test_a_report_may_be_replaced_by_the_command_that_wrote_it(
    tenodesis: Command, desk: Path, monkeypatch: pytest.MonkeyPatch, words: str, key: str
) -> None:
    from tenodesis.cli import bench, tolerance, vertices

    asked: list[str] = []

    def work(*_: object, **__: object) -> None:
        asked.append(words)
        raise tn.Error("enough.")

    monkeypatch.setattr(bench, "run", work)
    monkeypatch.setattr(vertices.rounder_vertices, "study", work)
    monkeypatch.setattr(tolerance.tolerance, "study", work)
    folder = desk / "there"
    folder.mkdir()
    numbers = folder / ("tolerance.json" if key == "responses" else "results.json")
    numbers.write_text(f'{{"about": {{"tenodesis": "0.1.0"}}, "{key}": {{}}}}')
    assert "enough" in tenodesis(*words.split(), "--out", "there")[2]
    numbers.write_text('{"about": {"tenodesis": "0.1.0"}, "other": {}}')
    assert "exists already" in tenodesis(*words.split(), "--out", "there")[2]
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("record scaled-up short.mcap --out short.mcap", "--out would write short.mcap, which is an input"),
        ("record own.mcap short.toml --out own.mcap", "--out would write own.mcap, which is an input"),
        ("record scaled-up short.toml --law robust --controller-instrument own.mcap --out own.mcap", "is an input"),
        ("replay run.mcap --out run.mcap", "--out would write run.mcap, which is an input"),
        ("replay run.mcap --out folder.mcap/../run.mcap", "which is an input"),
        ("transfer real-size run.mcap --out run.mcap", "--out would write run.mcap, which is an input"),
        ("transfer own.toml run.mcap --instrument-out own.toml", "--instrument-out would write own.toml, which is an"),
        ("export recording run.csv --out run.csv", "--out would write run.csv, which is an input"),
        ("export recording run.csv", "--out would write run.csv, which is an input"),
        ("export controller own.h --out own.h", "--out would write own.h, which is an input"),
        ("export urdf own.urdf --out own.urdf", "--out would write own.urdf, which is an input"),
        ("identify run.mcap --instrument out/identification/instrument.toml", "which is an input"),
        ("identify run.mcap --json-out run.mcap", "--json-out would write run.mcap, which is an input"),
        ("plan-identification out/plan-identification/protocol.toml", "which is an input"),
        ("scale prototype/scaled-up.toml", "which is an input"),
        ("tolerance real-size scaled-up --tolerances out/tolerance/samples.csv", "which is an input"),
    ],
)
def test_an_input_is_not_written_over_even_if_asked(tenodesis: Command, desk: Path, words: str, sentence: str) -> None:
    for path in ("out/identification/instrument.toml", "out/plan-identification/protocol.toml"):
        (desk / path).parent.mkdir(parents=True)
        shutil.copy(desk / "own.toml", desk / path)
    (desk / "prototype").mkdir()
    shutil.copy(ROOT / "instruments/real-size.toml", desk / "prototype/scaled-up.toml")
    (desk / "out/tolerance").mkdir()
    (desk / "out/tolerance/samples.csv").write_text(
        '[[parameters]]\nkey = "pretension"\ndistribution = "normal"\nstandard_deviation = "1 %"\n'
    )
    refused(tenodesis, desk, f"{words} --overwrite", sentence)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("bench pulley.toml --out /proc/tenodesis", "/proc/tenodesis cannot be written: "),
        ("scale real-size --out notes.txt/in", "notes.txt/in cannot be written: Not a directory."),
        (f"{TWO} --out notes.txt", "notes.txt cannot be written: "),
        ("vertices --out /proc/tenodesis", "/proc/tenodesis cannot be written: "),
        (f"{IDENTIFY} --out notes.txt", "notes.txt cannot be written: "),
        (f"{IDENTIFY} --json-out nowhere/x.json", "nowhere/x.json cannot be written: there is no folder nowhere."),
        ("plan-identification scaled-up --out notes.txt", "notes.txt cannot be written: "),
        ("record scaled-up short.toml --out nowhere/x.mcap", "x.mcap cannot be written: there is no folder nowhere."),
        ("record scaled-up short.toml --out folder.mcap", "folder.mcap, which is a folder; give the path of a file."),
        ("replay run.mcap --plot-out nowhere/x.png", "nowhere/x.png cannot be written: there is no folder nowhere."),
        ("transfer real-size run.mcap --out folder.mcap", "which is a folder; give the path of a file."),
        (
            "record scaled-up short.toml --out x.csv",
            "must end in .mcap; for a table: tenodesis export recording x.mcap",
        ),
        (
            "replay run.mcap --plot-out x.gif",
            "--plot-out writes a figure, whose name must end in .png or .svg or .pdf.",
        ),
        ("transfer real-size run.mcap --instrument-out x.mcap", "writes an instrument file, whose name must end in"),
        ("export recording run.mcap --out x.mcap", "a CSV table or a Parquet table, whose name must end in .csv or"),
        ("export controller scaled-up --out x.c", "--out writes a C header, whose name must end in .h."),
        ("export urdf scaled-up --out x.toml", "--out writes a URDF file, whose name must end in .urdf or .xml."),
        ("export mjcf scaled-up --out x.urdf", "--out writes a MuJoCo model, whose name must end in .xml."),
        (f"{IDENTIFY} --json-out x.csv", "--json-out writes a JSON file, whose name must end in .json."),
    ],
)
def test_what_cannot_be_written_is_refused_at_once(tenodesis: Command, desk: Path, words: str, sentence: str) -> None:
    refused(tenodesis, desk, words, sentence)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("record cycles", "cycles is a protocol, which needs an instrument: tenodesis record scaled-up cycles"),
        ("record cycles scaled-up", "the instrument comes first: tenodesis record scaled-up cycles."),
        ("record scaled-up own.toml", "own.toml describes an instrument; it must describe a protocol."),
        ("record scaled-up real-size", "real-size is an instrument; it must be a protocol: cycles, "),
        ("record scaled-up run.mcap", "run.mcap is a recording, MCAP; it must be a TOML file."),
        ("record run.mcap cycles", "run.mcap is a recording, MCAP; it must be a TOML file."),
        ("record scaled-up parts.toml", "parts.toml describes a catalogue; it must describe a protocol."),
        ("check short.toml", "short.toml describes a protocol; it must describe an instrument."),
        ("check widths.toml", "widths.toml describes tolerances; it must describe an instrument."),
        ("check notes.txt", "notes.txt is not valid TOML"),
        ("check bytes.toml", "bytes.toml is not UTF-8 text; it must be a TOML file."),
        ("check folder.mcap", "folder.mcap: there is no such file and no instrument of that name"),
        ("bench short.toml", "short.toml describes a protocol; it must describe an instrument."),
        ("scale short.toml", "short.toml describes a protocol; it must describe an instrument."),
        ("scale real-size --catalogue own.toml", "own.toml describes an instrument; it must describe a catalogue."),
        (f"{TWO} --tolerances own.toml", "own.toml describes an instrument; it must describe tolerances."),
        ("tolerance scaled-up real-size", "the real-size instrument comes first, the scaled-up one second."),
        ("vertices short.toml", "short.toml describes a protocol; it must describe an instrument."),
        ("plan-identification short.toml", "short.toml describes a protocol; it must describe an instrument."),
        ("identify own.toml", "own.toml is no MCAP file"),
        (f"{IDENTIFY} --format davinci-tool --arrangement compare", "auto or file with the format davinci-tool"),
        (f"{IDENTIFY} --instrument short.toml", "short.toml describes a protocol; it must describe an instrument."),
        ("info own.toml", "own.toml is no MCAP file"),
        ("replay own.toml", "own.toml is no MCAP file"),
        ("replay run.mcap --instrument cycles", "cycles is a protocol; it must be an instrument"),
        ("export recording own.toml", "own.toml is no MCAP file"),
        ("export controller short.toml", "short.toml describes a protocol; it must describe an instrument."),
        ("export urdf run.mcap", "run.mcap is a recording, MCAP; it must be a TOML file."),
        ("transfer run.mcap real-size", "run.mcap is a recording, MCAP; it must be a TOML file."),
        ("transfer real-size own.toml", "own.toml is no MCAP file"),
        ("transfer big.toml run.mcap", "big is larger than scaled-up, on which LOG was recorded"),
        ("devices test short.toml serial", "short.toml describes a protocol; it must describe an instrument."),
        ("console short.toml --no-browser", "short.toml describes a protocol; it must describe an instrument."),
    ],
)
def test_an_input_of_another_kind_is_named(tenodesis: Command, desk: Path, words: str, sentence: str) -> None:
    text = (ROOT / "instruments/scaled-up.toml").read_text()
    big = text.replace('name = "scaled-up"', 'name = "big"').replace('"7.5 mm"', '"15 mm"').replace("16.875", "33.75")
    (desk / "big.toml").write_text(big)
    refused(tenodesis, desk, words, sentence)


@pytest.mark.parametrize("words", ["bench pulley.toml --out there", "vertices --out there", f"{IDENTIFY} --out there"])
def test_the_second_of_two_runs_into_a_folder_is_refused(tenodesis: Command, desk: Path, words: str) -> None:
    with locked_folder(desk / "there"):
        refused(tenodesis, desk, words, "there is being written by another command; wait for it, or give another path.")
    assert not (desk / "there").exists()


def test_the_second_of_two_runs_into_a_file_is_refused(tenodesis: Command, desk: Path) -> None:
    words = "record scaled-up short.toml --out x.mcap"
    with locked_file(desk / "x.mcap"):
        refused(tenodesis, desk, words, "x.mcap is being written by another command")
    assert ".x.mcap.lock" not in contents(desk)


def test_a_lock_that_a_dead_process_left_does_not_matter(desk: Path) -> None:
    (desk / ".x.mcap.lock").write_text("")
    with locked_file(desk / "x.mcap"):
        pass
    assert not (desk / ".x.mcap.lock").exists()


INTERRUPTED = (130, -signal.SIGINT)
"""What a shell shows as 130; Python ends by the signal itself where it came while code was being made from text."""


def stopped_within(process: subprocess.Popen[str], folder: Path) -> bool:
    """Stop a process; let it go on, and return False, if it has made the folder and not locked it yet."""
    process.send_signal(signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)
    try:
        with locked_folder(folder):
            pass
    except BlockingIOError:
        return True
    process.send_signal(signal.SIGCONT)
    return False


@pytest.mark.process
def test_ctrl_c_during_the_work_says_what_is_written_and_leaves_nothing_else(tmp_path: Path) -> None:
    first = start_command(tmp_path, "vertices", "--out", "there")
    there = tmp_path / "there"
    until(lambda: there.exists() and stopped_within(first, there), first)
    second = start_command(tmp_path, "vertices", "--out", "there")
    stderr = second.communicate(timeout=120)[1]
    assert second.returncode == 1
    assert stderr.startswith("tenodesis: there is being written by another command")
    first.send_signal(signal.SIGINT)
    first.send_signal(signal.SIGCONT)
    stderr = first.communicate(timeout=120)[1]
    assert first.returncode in INTERRUPTED
    assert stderr.strip() == "tenodesis: interrupted; nothing is written to there."
    assert list(tmp_path.iterdir()) == []


@pytest.mark.process
@pytest.mark.parametrize("module", ["typer", "numpy", "pydantic", "tenodesis.instrument", "tenodesis.cli.instrument"])
def test_ctrl_c_during_the_start_is_a_sentence(tmp_path: Path, module: str) -> None:
    process = start_command(tmp_path, "check", "real-size", python=("-X", "importtime"))
    assert process.stderr is not None
    for line in process.stderr:
        if line.rpartition("|")[2].strip().partition(".")[0] == module.partition(".")[0] and module in line:
            break
    process.send_signal(signal.SIGINT)
    stderr = [line for line in process.communicate(timeout=120)[1].splitlines() if not line.startswith("import time:")]
    if process.returncode:  # else it was done before the signal came
        assert process.returncode in INTERRUPTED
        assert [line for line in stderr if not line.startswith("tenodesis: interrupted")] == []


NEW, LOSS, MANY, HEADER = "new mine --defaults", "loss real-size", "loss needle-driver", "export controller scaled-up"


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (f"{NEW} --mechanism gearbox", "--mechanism"),
        *((f"{NEW} --distal-radius '{one}'", "--distal-radius") for one in ("-2 mm", "0 mm", "nan mm", "2")),
        *((f"{NEW} --pretension '{one}'", "--pretension") for one in ("30 mm", "inf N")),
        *((f"{NEW} --load '{one}'", "--load") for one in ("1 kg", "-1 N")),
        (f"{NEW} --rope hemp", "--rope"),
        (f"{NEW} --backbone-length '20 mm'", "--backbone-length"),
        *((f"{NEW} --handle-range '{one}'", "--handle-range") for one in ("90 mm", "200 deg")),
        (f"{NEW} --stem-diameter 5", "--stem-diameter"),
        (f"{NEW} --tendon-diameter '1 um' --pretension '3000 N'", "--pretension"),
        *((f"new '{name}'", "NAME") for name in ("", ".toml", "absent/mine")),
        *((f"{LOSS} --load '{one}'", "--load") for one in ("2", "2 mm", "-2 N", "nan N")),
        (f"{LOSS} --angle '60'", "--angle"),
        (f"{LOSS} --angle '170 deg'", "--angle of yaw"),
        (f"{LOSS} --axis yaw --angle '170 deg'", "--angle of yaw"),
        (f"{LOSS} --axis roll", "axis"),
        (f"{LOSS} --axis yaw --moment '0 1 N*mm'", "--moment"),
        (f"{LOSS} --axis yaw --grip '1 N'", "--grip"),
        *((f"{MANY} --load '{one}'", "--load") for one in ("2 N", "0 0 1 mm")),
        (f"{MANY} --angle '10 deg'", "--angle"),
        (f"{MANY} --angle '10 170 0 deg'", "--angle of jaw_1"),
        (f"{MANY} --axis yaw", "--axis"),
        ("bench absent.toml", "file"),
        ("bench real-size --scaled-up pulley.toml", "joint_type"),
        ("export controller absent", "file"),
        ("record absent short.toml", "file"),
        ("record scaled-up absent", "file"),
        ("record scaled-up short.toml --time-step 0.5", "--time-step"),
        ("check absent.toml --json", "file"),
        ("loss absent.toml --json", "file"),
        ("export controller needle-driver --law robust", "inst"),
        (f"{HEADER} --axis pitch", "axis"),
        (f"{HEADER} --observer paper", "observer"),
        *((f"{HEADER} --name {name}", "name") for name in ("2nd", "static", "tenodesis_step")),
    ],
)
def test_a_wrong_word_is_refused_by_its_key(
    declined: Callable[..., tn.Error], desk: Path, words: str, key: str
) -> None:
    before = contents(desk)
    assert declined(*shlex.split(words)).key == key
    assert contents(desk) == before
