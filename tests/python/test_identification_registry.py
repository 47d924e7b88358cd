"""Formats of recordings as plug-ins: found by entry points, imported when they are used, our own without them."""

import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS, Format
from tenodesis.identification.registry import GROUP, OURS, Formats

ROOT = Path(__file__).parents[2]


def test_the_package_declares_its_own_formats_as_it_finds_them_without_being_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["entry-points"][GROUP] == OURS


@pytest.mark.parametrize("name", OURS)
def test_every_format_can_be_used_and_knows_its_default_law(name: str) -> None:
    assert isinstance(FORMATS[name], Format)
    assert FORMATS[name].law in FORMATS[name].laws


@pytest.mark.process
def test_another_packages_format_is_found_and_cannot_take_the_name_of_ours(tmp_path: Path) -> None:
    (tmp_path / "stranger.py").write_text(
        "from tenodesis.identification.registry import Format\nTHEIRS = Format(print, print, law='coulomb')\n"
    )
    info = tmp_path / "stranger-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\ntheirs = stranger:THEIRS\nmcap = stranger:THEIRS\n")
    asked = "from tenodesis.identification import FORMATS as f; print(list(f)[-1], f['theirs'].law, f['mcap'].law)"
    found = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.append({str(tmp_path)!r}); {asked}"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert found.stdout.split() == ["theirs", "coulomb", "capstan"]


def test_a_format_that_cannot_be_imported_is_refused_in_one_sentence_and_harms_no_other() -> None:
    formats = Formats(
        {
            "gone": EntryPoint("gone", "tenodesis.nowhere:FORMAT", GROUP),
            "csv": EntryPoint("csv", OURS["csv"], GROUP),
        }
    )
    assert list(formats) == ["gone", "csv"] and len(formats) == 2 and "gone" in formats and "xls" not in formats
    assert formats["csv"] is FORMATS["csv"]
    with pytest.raises(IdentificationError, match=r"^format gone is not available here: .*nowhere") as refused:
        formats["gone"]
    assert refused.value.key == "format" and refused.value.value == "gone"
    with pytest.raises(KeyError):
        formats["xls"]
