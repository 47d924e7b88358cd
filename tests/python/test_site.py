"""What `make site` checks of the documentation site is found where it is wrong; the site itself is checked there."""

from pathlib import Path
from typing import Any

import pytest

from .conftest import ROOT

PAGE = '<h1 id="top">a</h1><a href="sub/other.html#there">b</a><img src="picture.svg">'


@pytest.fixture
def check_site(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(ROOT / "docs")
    import check_site

    return check_site


@pytest.fixture
def site(tmp_path: Path) -> Path:
    (tmp_path / "sub").mkdir()
    (tmp_path / "picture.svg").write_text("<svg/>", "utf-8")
    (tmp_path / "index.html").write_text(PAGE, "utf-8")
    (tmp_path / "sub/other.html").write_text('<h2 id="there">c</h2><a href="../index.html#top">d</a>', "utf-8")
    return tmp_path


def test_a_sound_site_has_nothing_to_report(site: Path, check_site: Any) -> None:
    assert check_site.broken_links(site) == check_site.outside_requests(site) == []


def test_a_broken_link_and_a_foreign_script_are_found(site: Path, check_site: Any) -> None:
    page = site / "sub/other.html"
    broken = '<a href="nowhere.html">a</a><a href="../index.html#nowhere">b</a>'
    foreign = '<script src="https://example.org/a.js"></script>'
    page.write_text(page.read_text("utf-8") + broken + foreign, "utf-8")
    (site / "style.css").write_text("a { background: url(//example.org/a.png) }", "utf-8")
    assert check_site.broken_links(site) == ["sub/other.html: ../index.html#nowhere", "sub/other.html: nowhere.html"]
    assert check_site.outside_requests(site) == [
        "style.css: //example.org/a.png",
        "sub/other.html: https://example.org/a.js",
    ]


def test_the_reference_is_asked_for_every_public_name(check_site: Any) -> None:
    names = [name for name, _ in check_site.public_names()]
    assert {"tenodesis.load", "tenodesis.statics.output_angle", "tenodesis.twin.Twin"} <= set(names)
