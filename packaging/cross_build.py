"""Build wheels for other systems on this one, with the compiler of the ziglang package.

Run by a Python with ziglang, abi3info, nanobind, scikit-build-core, cmake, ninja and pip; its version is the wheels'.
The headers of that Python stand in for the target's, so that a wheel for another processor or system shows that the
sources compile and link there. Only the wheel of this processor's manylinux target is for use.
"""

import argparse
import os
import platform
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import abi3info
import ziglang

ROOT = Path(__file__).parents[1]
ZIG = Path(ziglang.__file__).parent / "zig"

# For macOS, nanobind lists the names that Python defines in a file, which zig's linker does not read.
UNDEFINED = """\
for word; do
  shift
  case $word in -Wl,@*darwin-ld*.sym) word=-Wl,-undefined,dynamic_lookup ;; esac
  set -- "$@" "$word"
done
"""

# What a program sees of the system where pyconfig.h is another: Windows' is not part of a Python for Linux.
WINDOWS_PYCONFIG = """\
#define MS_WIN32
#define MS_WIN64
#define MS_WINDOWS
#define NT_THREADS
#define HAVE_DECLSPEC_DLL
#define Py_ENABLE_SHARED
#define SIZEOF_SHORT 2
#define SIZEOF_INT 4
#define SIZEOF_LONG 4
#define SIZEOF_LONG_LONG 8
#define SIZEOF_SIZE_T 8
#define SIZEOF_VOID_P 8
#define SIZEOF_TIME_T 8
#define SIZEOF_WCHAR_T 2
#define SIZEOF_PID_T 4
#define ALIGNOF_MAX_ALIGN_T 16
typedef __int64 Py_ssize_t;
#define HAVE_PY_SSIZE_T 1
#define PY_SSIZE_T_MAX 0x7fffffffffffffffLL
"""


class Target(NamedTuple):
    """A system to build for."""

    zig: str
    system: str
    """CMAKE_SYSTEM_NAME."""
    processor: str
    platform: str
    """Platform tag of the wheel."""


TARGETS = {
    "linux-x86_64": Target("x86_64-linux-gnu.2.28", "Linux", "x86_64", "manylinux_2_28_x86_64"),
    "linux-aarch64": Target("aarch64-linux-gnu.2.28", "Linux", "aarch64", "manylinux_2_28_aarch64"),
    "musl-x86_64": Target("x86_64-linux-musl", "Linux", "x86_64", "musllinux_1_2_x86_64"),
    "musl-aarch64": Target("aarch64-linux-musl", "Linux", "aarch64", "musllinux_1_2_aarch64"),
    "macos-x86_64": Target("x86_64-macos.11.0", "Darwin", "x86_64", "macosx_11_0_x86_64"),
    "macos-arm64": Target("aarch64-macos.11.0", "Darwin", "arm64", "macosx_11_0_arm64"),
    "windows-amd64": Target("x86_64-windows-gnu", "Windows", "AMD64", "win_amd64"),
}


def main() -> None:
    """Build the wheels of the targets that are named on the command line, or of all."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; all by default")
    options.add_argument("--out", type=Path, default=ROOT / "dist")
    options.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options.add_argument("--quick", action="store_true", help="do not optimise: only show that it compiles and links")
    chosen = options.parse_args()
    unknown = set(chosen.targets) - set(TARGETS)
    if unknown:
        options.error(f"there is no target {', '.join(sorted(unknown))}; there are {', '.join(TARGETS)}")
    for name in chosen.targets or TARGETS:
        target = TARGETS[name]
        if sys.version_info < (3, 12) and target.system != "Linux":
            sys.exit(f"{name} needs Python 3.12 or newer: of an older one the stable interface has no headers.")
        tools = ROOT / "build/cross" / name
        tools.mkdir(parents=True, exist_ok=True)
        build(target, tools, chosen.out.resolve(), chosen.jobs, chosen.quick)


def build(target: Target, tools: Path, out: Path, jobs: int, quick: bool) -> None:
    """Build the wheel of a target with tools that are written to a folder."""
    last = ["-O0"] if quick else []
    include = sysconfig.get_path("include")
    flags = ["-target", target.zig]
    defined = {"CMAKE_SYSTEM_NAME": target.system, "CMAKE_SYSTEM_PROCESSOR": target.processor}
    if target.system == "Windows":
        (tools / "pyconfig.h").write_text(WINDOWS_PYCONFIG)
        (tools / "libdl.a").write_text("!<arch>\n")  # CMake takes the libraries of this Python for the target's
        flags += [f"-I{tools}", f"-L{tools}"]
        defined["SKBUILD_SOSABI"] = ""  # the name is _core.pyd
        version = f"{sys.version_info.major}{sys.version_info.minor}"
        defined["Python_LIBRARY"] = import_library(tools / f"libpython{version}.a")
        defined["Python_SABI_LIBRARY"] = import_library(tools / "libpython3.a")
    script(tools / "cxx", ["c++", *flags], last)
    script(tools / "ar", ["ar"])
    script(tools / "ranlib", ["ranlib"])
    defined |= {
        "CMAKE_CXX_COMPILER": tools / "cxx",
        "CMAKE_AR": tools / "ar",
        "CMAKE_RANLIB": tools / "ranlib",
        "CMAKE_CROSSCOMPILING_EMULATOR": "/usr/bin/env",  # Python, the only program that the build runs, is this one
        "Python_INCLUDE_DIR": include,
        "CMAKE_FIND_ROOT_PATH_MODE_PACKAGE": "BOTH",
        "CMAKE_BUILD_WITH_INSTALL_RPATH": "ON",  # to change it afterwards takes a tool of macOS
        "TENODESIS_STUB": "ON" if is_own(target) else "OFF",
    }
    toolchain = tools / "toolchain.cmake"
    toolchain.write_text("".join(f'set({name} "{value}" CACHE STRING "")\n' for name, value in defined.items()))
    stable = sys.version_info >= (3, 12)
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    tag = f"{'cp312-abi3' if stable else f'{python}-{python}'}-{target.platform}"
    suffix = {} if stable else {"SETUPTOOLS_EXT_SUFFIX": soabi(target)}
    settings = {
        "cmake.toolchain-file": toolchain,
        "wheel.tags": tag,
        "build-dir": f"build/{tag}",
        "build.tool-args": f"-j{jobs}",
    }
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", out, "-v"]
    command += [word for name, value in settings.items() for word in ("--config-settings", f"{name}={value}")]
    subprocess.run([*command, ROOT], check=True, env=os.environ | suffix)


def is_own(target: Target) -> bool:
    """Return whether the Python that builds can import a target's module."""
    return sys.platform == "linux" and "-linux-gnu" in target.zig and target.processor == platform.machine()


def soabi(target: Target) -> str:
    """Return the file name's end of a module for Linux that is not of the stable interface."""
    library = "musl" if "musl" in target.zig else "gnu"
    return f".cpython-{sys.version_info.major}{sys.version_info.minor}-{target.processor}-linux-{library}.so"


def import_library(library: Path) -> Path:
    """Write and return an import library for python3.dll: the names of the stable interface."""
    names = [symbol.name for symbol in abi3info.FUNCTIONS]
    data = [f"{symbol.name} DATA" for symbol in abi3info.DATAS]
    definition = library.with_suffix(".def")
    definition.write_text("\n".join(["LIBRARY python3.dll", "EXPORTS", *names, *data, ""]))
    subprocess.run([ZIG, "dlltool", "-m", "i386:x86-64", "-d", definition, "-l", library], check=True)
    return library


def script(path: Path, first: list[str], last: Sequence[str] = ()) -> None:
    """Write a program that calls zig with words before and behind its own."""
    path.write_text(f'#!/bin/sh\n{UNDEFINED}exec "{ZIG}" {" ".join(first)} "$@" {" ".join(last)}\n')
    path.chmod(0o755)


if __name__ == "__main__":
    main()
