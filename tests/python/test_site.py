"""Claims about the documentation site, built without executing its tutorials, which `make site` executes."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from .conftest import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.process]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("myst_nb")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet"]
    command += ["--define", "nb_execution_mode=off", str(ROOT / "docs"), str(out)]
    subprocess.run(command, check=True, timeout=300)
    return out


@pytest.fixture
def check_site(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(ROOT / "docs")
    import check_site

    return check_site


def test_every_link_and_anchor_of_the_site_leads_somewhere(site: Path, check_site: Any) -> None:
    assert check_site.broken_links(site) == []


def test_the_site_loads_nothing_from_another_host(site: Path, check_site: Any) -> None:
    assert check_site.outside_requests(site) == []


def test_every_public_name_is_in_the_reference(site: Path, check_site: Any) -> None:
    assert len(list(check_site.public_names())) > 150
    assert check_site.missing_names(site) == []


def test_a_broken_link_and_a_foreign_script_are_found(site: Path, tmp_path: Path, check_site: Any) -> None:
    copy = tmp_path / "site"
    shutil.copytree(site, copy)
    page = copy / "api/statics.html"
    broken = '<a href="nowhere.html">a</a><a href="../model.html#nowhere">b</a><script src="https://example.org/a.js">'
    page.write_text(page.read_text("utf-8") + broken + "</script>", "utf-8")
    assert check_site.broken_links(copy) == [
        "api/statics.html: ../model.html#nowhere",
        "api/statics.html: nowhere.html",
    ]
    assert check_site.outside_requests(copy) == ["api/statics.html: https://example.org/a.js"]
