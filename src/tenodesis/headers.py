"""Folders of the C++ headers and of the CMake package, for programs in C++ and C."""

from pathlib import Path

_PACKAGE = Path(__file__).parent
# An editable install has them in the source tree alone.
_ROOT = _PACKAGE if (_PACKAGE / "include").is_dir() else _PACKAGE.parents[1]


def get_include() -> str:
    """Return the folder to give to a compiler's ``-I``; the source of the C interface is ``../src/c`` from there."""
    return str(_ROOT / "include")


def get_cmake_dir() -> str:
    """Return the folder to give to CMake as ``tenodesis_DIR``, for ``find_package(tenodesis)``."""
    return str(_ROOT / "cmake")
