"""Claims about programs in C++ and C that use the core, each built as its author would and compared with Python."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TypeAlias

import pytest

import tenodesis as tn
from tenodesis import control
from tenodesis.instrument import Instrument

from .conftest import EXAMPLES, ROOT, Command

CONSUMERS = ROOT / "tests/consumers"
REALS = {"float": 4, "double": 8}
WARNINGS = "-Wall -Wextra -Wpedantic -Werror"
# CMake and Ninja lie beside Python; compilers need not be the ones that Python was built with.
PATH = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
NEEDED = {name: shutil.which(name, path=PATH) for name in ("c++", "cc", "cmake", "make", "ninja", "nm", "pkg-config")}

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(None in NEEDED.values(), reason=f"needs {', '.join(NEEDED)}"),
]

Prefixes: TypeAlias = dict[str, Path]


def run(*command: object, **environment: object) -> str:
    own = (
        os.environ | {"PATH": PATH, "CC": "cc", "CXX": "c++"} | {key: str(value) for key, value in environment.items()}
    )
    done = subprocess.run([*map(str, command)], env=own, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def built(source: Path, build: Path, **variables: object) -> Path:
    """Return the folder of a CMake project's build."""
    given = {"CMAKE_C_FLAGS": WARNINGS, "CMAKE_CXX_FLAGS": WARNINGS, "CMAKE_BUILD_TYPE": "Debug"} | variables
    run("cmake", "-S", source, "-B", build, "-G", "Ninja", *(f"-D{name}={value}" for name, value in given.items()))
    run("cmake", "--build", build, "--parallel", 2)
    return build


@pytest.fixture(scope="module")
def prefixes(tmp_path_factory: pytest.TempPathFactory) -> Prefixes:
    """Folders for CMAKE_PREFIX_PATH: two installations, and what the wheel contains for CMake."""
    prefixes = {"package": tmp_path_factory.mktemp("package")}
    for part in ("CMakeLists.txt", "cmake", "include/tenodesis", "src/c"):
        copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy
        (prefixes["package"] / part).parent.mkdir(parents=True, exist_ok=True)
        copy(ROOT / part, prefixes["package"] / part)
    for kind in ("static", "shared"):
        build, prefix = tmp_path_factory.mktemp(f"build-{kind}"), tmp_path_factory.mktemp(f"prefix-{kind}")
        options = {"BUILD_SHARED_LIBS": kind == "shared", "TENODESIS_BUILD_TESTS": False, "CMAKE_INSTALL_LIBDIR": "lib"}
        built(ROOT, build, **options)
        run("cmake", "--install", build, "--prefix", prefix)
        prefixes[kind] = prefix
    return prefixes


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exported")
    control.export_header(tn.load("scaled-up"), folder / "scaled_up.h", homed=True)
    return folder


def assert_output_angle(printed: str, inst: Instrument) -> None:
    version, angle = printed.split()
    assert version == tn.__version__
    assert float(angle) == pytest.approx(tn.statics.output_angle(inst, 0.3, 1.0), rel=1e-12)


def assert_first_tick(printed: str, inst: Instrument, real: str) -> None:
    size, angle = printed.split()
    precision = "single" if real == "float" else "double"
    controller = control.Controller(inst, precision=precision, enabled=False)
    out = controller.step(0.0, 0.3, (31.0, 19.0), (0.25, -0.125), control.Request.ENABLE)
    assert int(size) == REALS[real]
    assert float(angle) == pytest.approx(out.output_angle, rel=1e-12 if real == "double" else 1e-6)
    assert abs(out.output_angle) > 0.1


def test_fetch_content_gives_the_headers_and_builds_nothing_else(tmp_path: Path, scaled: Instrument) -> None:
    build = built(CONSUMERS / "fetch_content", tmp_path, TENODESIS=ROOT)
    assert_output_angle(run(build / "consumer"), scaled)
    assert [path.name for path in build.rglob("*.o")] == ["output_angle.cpp.o"]


def test_the_program_of_the_page_builds(tmp_path: Path) -> None:
    page = (ROOT / "docs/cpp.md").read_text("utf-8")
    project, program = (re.search(rf"```{language}\n(.*?)```", page, re.DOTALL) for language in ("cmake", "cpp"))
    assert project is not None and program is not None
    assert len(project[1].splitlines()) <= 10
    (tmp_path / "CMakeLists.txt").write_text(project[1].replace("/path/to/tenodesis", str(ROOT)))
    (tmp_path / "main.cpp").write_text(program[1])
    expected = tn.statics.output_angle(tn.load("real-size").planar[0], 0.3, 1.0)
    assert float(run(built(tmp_path, tmp_path / "build") / "mine").split()[0]) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("kind", ["static", "package"])
def test_find_package_gives_the_headers(tmp_path: Path, prefixes: Prefixes, scaled: Instrument, kind: str) -> None:
    build = built(CONSUMERS / "find_package", tmp_path, CMAKE_PREFIX_PATH=prefixes[kind])
    assert_output_angle(run(build / "consumer"), scaled)


def test_python_names_the_folders_of_headers_and_package(tmp_path: Path, scaled: Instrument) -> None:
    build = built(CONSUMERS / "find_package", tmp_path, tenodesis_DIR=tn.get_cmake_dir())
    assert_output_angle(run(build / "consumer"), scaled)
    assert (Path(tn.get_include()) / "tenodesis/tenodesis.h").is_file()
    assert (Path(tn.get_include()) / "../src/c/tenodesis.cpp").is_file()


def test_find_package_refuses_another_minor_version(tmp_path: Path, prefixes: Prefixes) -> None:
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.24)\nproject(consumer LANGUAGES NONE)\n"
        "find_package(tenodesis 0.0 CONFIG)\n"
        "message(STATUS ${tenodesis_FOUND},${tenodesis_CONSIDERED_VERSIONS})\n"
    )
    for kind in ("static", "package"):
        prefix = f"-DCMAKE_PREFIX_PATH={prefixes[kind]}"
        said = run("cmake", "-S", tmp_path, "-B", tmp_path, "-G", "Ninja", "--fresh", prefix)
        assert f"-- 0,{tn.__version__}\n" in said


def test_add_subdirectory_gives_the_c_library(tmp_path: Path, exported: Path, scaled: Instrument) -> None:
    build = built(CONSUMERS / "add_subdirectory", tmp_path, TENODESIS=ROOT, EXPORTED=exported, REAL="float")
    assert_first_tick(run(build / "consumer"), scaled, "float")
    assert {path.name for path in build.rglob("*.o")} == {"first_tick.c.o", "tenodesis.cpp.o"}


@pytest.mark.parametrize("real", REALS)
def test_pkg_config_gives_headers_and_c_library(
    tmp_path: Path, prefixes: Prefixes, exported: Path, scaled: Instrument, real: str
) -> None:
    folders = {"EXPORTED": exported, "OUT": tmp_path, "PKG_CONFIG_PATH": prefixes["static"] / "lib/pkgconfig"}
    run("make", "-C", CONSUMERS / "pkg_config", REAL=real, CFLAGS=WARNINGS, CXXFLAGS=WARNINGS, **folders)
    assert_output_angle(run(tmp_path / "output_angle"), scaled)
    assert_first_tick(run(tmp_path / "first_tick"), scaled, real)


@pytest.mark.parametrize(("kind", "real"), [("static", "float"), ("shared", "double"), ("package", "double")])
def test_a_project_in_c_alone_links_the_c_library(
    tmp_path: Path, prefixes: Prefixes, exported: Path, scaled: Instrument, real: str, kind: str
) -> None:
    given = {"CMAKE_PREFIX_PATH": prefixes[kind], "EXPORTED": exported, "REAL": real}
    build = built(CONSUMERS / "c_shared", tmp_path, **given)
    assert_first_tick(run(build / "consumer"), scaled, real)


@pytest.mark.skipif(sys.platform != "linux", reason="reads ELF files")
@pytest.mark.parametrize("real", REALS)
def test_a_shared_library_exports_the_documented_functions_alone(prefixes: Prefixes, real: str) -> None:
    version = re.search(r"#define TENODESIS_VERSION (\d+)u", (ROOT / "include/tenodesis/tenodesis.h").read_text())
    assert version is not None
    library = prefixes["shared"] / f"lib/libtenodesis_c_{real}.so.{version[1]}"
    listed = run("nm", "-D", "--defined-only", library)
    assert set(re.findall(r" [^AT] (\S+)", listed)) == set()
    assert set(re.findall(r" T (\w+)@@", listed)) == documented_functions()
    needed = set(re.findall(r"NEEDED\s+(\S+)", run("objdump", "-p", library)))
    assert needed == {"libc.so.6"}


def documented_functions() -> set[str]:
    text = (ROOT / "include/tenodesis/tenodesis.h").read_text()
    declarations = re.sub(r"/\*.*?\*/", "", text[text.index("Sets a controller up") :], flags=re.DOTALL)
    return set(re.findall(r"(\w+)\(", declarations))


@pytest.mark.skipif(sys.platform != "linux", reason="needs versioned symbols")
def test_both_precisions_load_into_one_program(tmp_path: Path, prefixes: Prefixes) -> None:
    lib = prefixes["shared"] / "lib"
    for real in REALS:
        source = f"#include <tenodesis/tenodesis.h>\nint {real}_size(void) {{ return (int)tenodesis_real_size(); }}\n"
        (tmp_path / f"{real}.c").write_text(source)
        given = ["-shared", "-fPIC", f"-I{prefixes['shared'] / 'include'}", tmp_path / f"{real}.c"]
        run("cc", *given, f"-L{lib}", f"-ltenodesis_c_{real}", f"-Wl,-rpath,{lib}", "-o", tmp_path / f"lib{real}.so")
    both = "int float_size(void), double_size(void);\nint main(void) { return 10 * float_size() + double_size() - 48; }"
    (tmp_path / "both.c").write_text(both)
    given = [f"-L{tmp_path}", "-lfloat", "-ldouble", f"-Wl,-rpath,{tmp_path}", f"-Wl,-rpath-link,{lib}"]
    run("cc", tmp_path / "both.c", *given, "-o", tmp_path / "both")
    run(tmp_path / "both")


@pytest.fixture(scope="module")
def c_interface(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The C interface as the example's own comment builds it."""
    path = tmp_path_factory.mktemp("object") / "tenodesis.o"
    options = ("-std=c++20", "-O1", "-fno-math-errno", f"-I{ROOT / 'include'}", "-c")
    run("c++", *options, ROOT / "src/c/tenodesis.cpp", "-o", path)
    return path


def test_the_example_controls_the_exported_instrument(tmp_path: Path, tenodesis: Command, c_interface: Path) -> None:
    assert tenodesis("export", "controller", EXAMPLES / "pulley.toml", "--homed", "--own-clock")[0] == 0
    said = run_example(tmp_path, c_interface, "-DINSTRUMENT=pulley_wrist")
    assert said.startswith("pulley_wrist: radii 4.5 and 2 mm, pretension 30 N")


def test_the_exported_header_wins_over_the_one_beside_the_example(
    tmp_path: Path, tenodesis: Command, c_interface: Path
) -> None:
    assert tenodesis("export", "controller", "real-size", "--homed", "--own-clock", "--name", "scaled_up")[0] == 0
    assert run_example(tmp_path, c_interface).startswith("scaled_up: radii 4.5 and 2 mm, pretension 30 N")


def run_example(folder: Path, c_interface: Path, *options: str) -> str:
    given = ["-std=c99", *WARNINGS.split(), f"-I{ROOT / 'include'}", f"-I{folder}", *options, EXAMPLES / "controller.c"]
    run("cc", *given, c_interface, "-lm", "-o", folder / "controller")
    return run(folder / "controller")
