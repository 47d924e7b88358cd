"""Claims about the package: it installs without a compiler and works from an empty folder, on every Python it names."""

import gzip
import os
import pkgutil
import re
import shutil
import subprocess
import sys
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

import tenodesis as tn

from .conftest import ROOT

PYTHONS = ("3.12", "3.13")
"""Besides the Python that runs the tests."""

PACKAGES_OF_THE_CORE = 35


class Installation(NamedTuple):
    """An environment of Python with the package, and an empty folder to work in."""

    python: Path
    folder: Path

    @property
    def environment(self) -> dict[str, str]:
        """No compiler is on its path, and nothing of this repository is in its way; other tests run beside it."""
        of_terminal = {"TERM": "dumb", "COLUMNS": "200"}
        return {"PATH": str(self.python.parent), "HOME": str(self.folder), "OPENBLAS_NUM_THREADS": "1"} | of_terminal

    def run(self, *words: str, code: int = 0) -> str:
        command = [self.python.parent / "tenodesis", *words]
        done = subprocess.run(
            command, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=600, check=False
        )
        assert done.returncode == code, (words, done.stdout, done.stderr)
        assert "Traceback" not in done.stderr
        return done.stdout if code == 0 else done.stderr


def uv(*words: str | Path, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "uv", "--quiet", *words],
        capture_output=True,
        text=True,
        check=False,
        env={name: text for name, text in os.environ.items() if name != "PYTHONPATH"} | environment,
    )
    assert done.returncode == 0, (words, done.stdout, done.stderr)
    return done.stdout


def interpreter(version: str) -> str:
    """Return the path of a Python of this version; without one the test is skipped."""
    kept = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    found = shutil.which(f"python{version}") if not kept else str(kept[-1])
    if found is None or subprocess.run([found, "-c", ""], check=False, capture_output=True).returncode:
        pytest.skip(f"Python {version} is not here")
    return found


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel for this Python; what `make build` has compiled is not compiled again."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", folder, ROOT]
    environment = {"CXX": "c++"} | os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    subprocess.run(command, check=True, env=environment)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def stable_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel for every Python from 3.12 on."""
    folder = tmp_path_factory.mktemp("stable")
    # Whether it works does not depend on how fast it is; twins in lanes know no Python: they are those of `make build`.
    compiler = folder / "c++"
    compiler.write_text(
        f"#!/bin/sh\nmade={ROOT}/build/cp3*/CMakeFiles/_core.dir/src/bindings\n"
        'for word; do [ "$last" = -o ] && out=$word; last=$word; done\nname=${out##*/}\n'
        "case $name in lanes_*.o)\n"
        'for one in $made/$name; do [ -f "$one" ] && exec cp "$one" "$out"; done;; esac\n'
        'exec c++ "$@" -O0 -DTENODESIS_FEW_SIZES\n',
        "utf-8",
    )
    compiler.chmod(0o755)
    uv("build", "--wheel", "--python", interpreter("3.12"), "--out-dir", folder, ROOT, CXX=str(compiler))
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture
def install(tmp_path: Path) -> Callable[..., Installation]:
    def install(wheel: Path, python: str = sys.executable, extras: str = "", *more: str | Path) -> Installation:
        environment, folder = tmp_path / "environment", tmp_path / "empty"
        folder.mkdir(exist_ok=True)
        uv("venv", "--clear", "--python", python, environment)
        to = environment / "bin/python"
        uv("pip", "install", "--only-binary", ":all:", "--python", to, f"tenodesis{extras} @ {wheel.as_uri()}", *more)
        return Installation(to, folder)

    return install


@contextmanager
def serving(installed: Installation) -> Iterator[bytes]:
    """Yield the page that a browser gets from the console's address, which gives it a cookie first."""
    command = [installed.python.parent / "tenodesis", "console", "--no-browser"]
    with subprocess.Popen(
        command,
        cwd=installed.folder,
        env=installed.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as console:
        try:
            assert console.stdout is not None
            lines = []
            for line in console.stdout:
                lines.append(line)
                address = re.search(r"Console: (http\S+)", line)
                if address:
                    break
            assert lines and address, lines
            browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
            browser.open(address[1], timeout=60).close()
            with browser.open(urllib.parse.urljoin(address[1], "/"), timeout=60) as answer:
                assert answer.status == 200
                yield gzip.decompress(answer.read())
        finally:
            console.terminate()


def modules_of_the_package() -> list[str]:
    """Return those that import without an extra: an environment is one of Gymnasium's classes."""
    names = [info.name for info in pkgutil.walk_packages(tn.__path__, "tenodesis.")]
    return [name for name in names if "__main__" not in name and not name.startswith("tenodesis.gym")]


def use(installed: Installation, *chapters: str) -> None:
    """Run the commands of a first hour; the bench with these chapters, since `test_paper.py` runs it whole."""
    assert "real-size: tendon-gear" in installed.run("check", "real-size")
    cycles = (ROOT / "src/tenodesis/simulate/shipped/cycles.toml").read_text("utf-8")
    short = cycles.replace("count = 2", "count = 1").replace("20 deg/s", "40 deg/s")
    (installed.folder / "bench.toml").write_text(short, "utf-8")
    installed.run("record", "scaled-up", "bench.toml", "--out", "run.mcap")
    quick = ("--starts", "1", "--arrangement", "file")
    assert "friction" in installed.run("identify", "run.mcap", *quick, "--out", "identified")
    installed.run("bench", "--only", ",".join(chapters))
    assert (installed.folder / "out/report.html").is_file()


def test_the_citation_names_the_version_of_the_header() -> None:
    assert f"version: {tn.__version__}" in (ROOT / "CITATION.cff").read_text("utf-8").splitlines()


@pytest.mark.slow
@pytest.mark.process
def test_the_installed_package_works_from_an_empty_folder(wheel: Path, install: Callable[..., Installation]) -> None:
    installed = install(wheel)
    packages = uv("pip", "list", "--python", installed.python, "--format", "freeze").split()
    assert len([name for name in packages if not name.startswith("tenodesis")]) <= PACKAGES_OF_THE_CORE
    use(installed, "loss", "slack", "workspace")
    assert "code is with the tests" in installed.run("bench", "--only", "checks", code=1)
    assert "pip install 'tenodesis[design]'" in installed.run("scale", "real-size", code=1)
    refusal = installed.run("console", "--no-browser", code=1)
    assert "pip install 'tenodesis[live]'" in refusal
    assert len(refusal.strip().splitlines()) == 1


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize("version", PYTHONS)
def test_one_wheel_serves_every_python_from_3_12_on(
    stable_wheel: Path, install: Callable[..., Installation], version: str
) -> None:
    assert "-cp312-abi3-" in stable_wheel.name
    installed = install(stable_wheel, interpreter(version))
    installed.run("check", "real-size")
    installed.run("bench", "--only", "loss,slack")


@pytest.mark.slow
@pytest.mark.process
def test_the_package_works_with_the_lowest_versions_that_it_allows(
    wheel: Path, install: Callable[..., Installation], tmp_path: Path
) -> None:
    lowest = tmp_path / "lowest.txt"
    uv(
        *("pip", "compile", ROOT / "pyproject.toml", "--extra", "all", "--resolution", "lowest-direct"),
        *("--only-binary", ":all:", "--python", sys.executable, "--output-file", lowest),
    )
    installed = install(wheel, sys.executable, "", "--requirements", lowest)
    use(installed, "loss", "slack")
    installed.run("scale", "real-size", "--combinations", "1000")
    code = f"import importlib\nfor name in {modules_of_the_package()}: importlib.import_module(name)"
    done = subprocess.run([installed.python, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with serving(installed) as page:
        assert b"<html" in page


@pytest.mark.slow
@pytest.mark.process
def test_the_console_serves_its_page_with_its_extra(wheel: Path, install: Callable[..., Installation]) -> None:
    with serving(install(wheel, sys.executable, "[live]")) as page:
        assert b"<html" in page
