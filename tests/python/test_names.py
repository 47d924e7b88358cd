"""Claims about what a user sees who asks for the names of the package."""

import re
import subprocess
import sys
from functools import reduce
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import tenodesis as tn

MIGRATION = Path(__file__).parents[2] / "docs" / "migration.md"
PACKAGES = tuple(name for name in tn.__all__ if isinstance(getattr(tn, name), ModuleType))


@pytest.mark.parametrize("name", ["", *PACKAGES, "identification.experiment"])
def test_a_package_shows_its_public_names_and_nothing_else(name: str) -> None:
    module = import_module(f"tenodesis.{name}".rstrip("."))
    shown = dir(module)
    assert shown == sorted(set(module.__all__))
    for one in shown:
        found = getattr(module, one)
        assert not (isinstance(found, ModuleType) and not found.__name__.startswith("tenodesis."))
        assert not one.startswith("_") or one == "__version__"


@pytest.mark.process
def test_the_names_are_there_before_anything_is_loaded_and_an_instrument_loads_no_heavy_library() -> None:
    code = (
        "import sys, tenodesis as tn; names = dir(tn); assert names == sorted(tn.__all__); "
        "assert not {'numpy', 'pydantic', 'matplotlib'} & set(sys.modules); "
        "tn.load; tn.statics; tn.twin; tn.simulate; "
        "heavy = {'pint', 'matplotlib', 'viser', 'typst', 'scipy', 'mujoco'} & set(sys.modules); "
        "assert not heavy, heavy; "
        "assert all(hasattr(tn, name) for name in names); assert not hasattr(tn, 'absent')"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_exception_is_shown() -> None:
    own = {name for name, one in vars(tn.errors).items() if getattr(one, "__module__", "") == "tenodesis.errors"}
    assert {name for name in own if name[0] != "_"} == set(tn.errors.__all__)


def test_names_that_have_moved_are_where_the_table_says() -> None:
    text = MIGRATION.read_text("utf-8")
    moved = [now for _, now in re.findall(r"^\| `tn\.([\w.]+)` \| `tn\.([\w.]+)` \|$", text, re.MULTILINE)]
    for names, package in re.findall(r"^\| `tn\.coupled`: (.*) \| `tn\.(\w+)` \|$", text, re.MULTILINE):
        moved += [f"{package}.{name}" for name in re.findall(r"`(\w+)`", names)]
    assert len(moved) > 40
    for name in moved:
        reduce(getattr, name.split("."), tn)
