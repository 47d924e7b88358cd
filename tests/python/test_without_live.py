"""Claims about a build without the live runtime, as on macOS and Windows: all else works, and a sentence says so."""

import subprocess
import sys
from pathlib import Path

import pytest

from .conftest import EXAMPLES

SENTENCE = "The live runtime and the link to boards are not part of this build; they run on Linux."

LIVE = (
    *(
        "LoopProblem",
        "Order",
        "LiveDevice",
        "TwinDevice",
        "JointSwitch",
        "LiveJoints",
        "MailboxDevice",
        "Runtime",
        "RingReader",
        "tick_columns",
    ),
    *("LinkProblem", "BoardController", "SerialController", "StreamedController", "StreamedDevice"),
)
HIDE = f"from tenodesis import _core\nfor name in {LIVE!r}:\n    delattr(_core, name)\n"
"""Leaves of the C++ module what CMake's option TENODESIS_LIVE=OFF leaves."""


def run(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", HIDE + code]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, timeout=300)


@pytest.mark.process
def test_without_the_live_runtime_only_its_own_modules_refuse_to_be_imported(tmp_path: Path) -> None:
    done = run(
        """
import importlib, pkgutil
import tenodesis
from tenodesis.errors import LiveError
refused = set()
for info in pkgutil.walk_packages(tenodesis.__path__, "tenodesis."):
    if "__main__" in info.name:
        continue
    try:
        importlib.import_module(info.name)
    except LiveError as problem:
        refused.add(info.name)
        assert str(problem) == """
        + repr(SENTENCE)
        + """
print(*{name.split(".")[1] for name in refused - {"tenodesis.cli.live"}})
""",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split()) <= {"console", "live"}


@pytest.mark.process
@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["check", "real-size"], 0),
        (["record", "scaled-up", str(EXAMPLES / "protocol.toml"), "--out", "run.mcap"], 0),
        (["devices"], 0),
        (["console", "--no-browser"], 1),
        (["devices", "test", "scaled-up", "serial", "--address", "unix:///nowhere"], 1),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_without_the_live_runtime_a_command_works_or_says_so(tmp_path: Path, words: list[str], code: int) -> None:
    done = run(
        f"import sys\nfrom tenodesis.cli.commands import main\nsys.argv = {['tenodesis', *words]!r}\nmain()", tmp_path
    )
    assert done.returncode == code, (done.stdout, done.stderr)
    if code:
        assert done.stderr.strip() == f"tenodesis: {SENTENCE}"
