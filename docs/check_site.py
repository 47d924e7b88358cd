"""Check a built site: links and anchors lead somewhere, nothing is loaded from elsewhere, every public name is there.

python docs/check_site.py build/site
"""

import importlib
import pkgutil
import re
import sys
import zlib
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from pydoc import locate
from typing import get_args
from urllib.parse import unquote, urlsplit

import tenodesis

_LOADED = {"img": ("src", "srcset"), "script": ("src",), "iframe": ("src",), "source": ("src", "srcset")}


class _Page(HTMLParser):
    """Collects where a page links to, what it loads, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect what one tag has."""
        values = {name: value for name, value in attrs if value}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "link" and values.get("rel") not in ("canonical", "search", "next", "prev", "index"):
            self.loaded.append(values.get("href", ""))
        self.loaded += [values[name] for name in _LOADED.get(tag, ()) if name in values]


def broken_links(site: Path) -> list[str]:
    """Return the links and loaded files of all pages that lead nowhere within the site, as "page: target"."""
    pages = {path: _Page(path.read_text("utf-8")) for path in site.rglob("*.html")}
    broken = []
    for path, page in pages.items():
        for target in [*page.links, *page.loaded]:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchor = unquote(parts.fragment)
            if not file.exists() or (anchor and file in pages and anchor not in pages[file].anchors):
                broken.append(f"{path.relative_to(site)}: {target}")
    return sorted(set(broken))


def outside_requests(site: Path) -> list[str]:
    """Return what pages and style sheets load from another host, as "file: target"."""
    found = []
    for path in site.rglob("*.html"):
        loaded = _Page(path.read_text("utf-8")).loaded
        found += [f"{path.relative_to(site)}: {target}" for target in loaded if urlsplit(target).netloc]
    for path in site.rglob("*.css"):
        text = path.read_text("utf-8")
        found += [f"{path.relative_to(site)}: {url}" for url in re.findall(r"url\(['\"]?((?:https?:)?//[^)]*)\)", text)]
    return sorted(set(found))


def public_names() -> Iterator[tuple[str, object]]:
    """Yield the public names of the package and of its public modules, with what they name."""
    modules = [tenodesis]
    modules += [
        importlib.import_module(f"tenodesis.{name}")
        for name in tenodesis.__all__
        if name in {module.name for module in pkgutil.iter_modules(tenodesis.__path__)}
    ]
    for module in modules:
        names = getattr(module, "__all__", None) or [
            name for name, thing in vars(module).items() if getattr(thing, "__module__", "") == module.__name__
        ]
        yield from ((f"{module.__name__}.{name}", getattr(module, name)) for name in names if name[0] != "_")


def missing_names(site: Path) -> list[str]:
    """Return the public names that the reference lacks, also under another name of the same class, function or type."""
    described = _inventory(site)
    located = [locate(name) for name in described]
    things = {id(thing) for thing in located if hasattr(thing, "__qualname__") or get_args(thing)}
    return sorted(name for name, thing in public_names() if name not in described and id(thing) not in things)


def _inventory(site: Path) -> set[str]:
    """Return the names that the site's reference describes (Sphinx's inventory, version 2)."""
    raw = (site / "objects.inv").read_bytes()
    lines = zlib.decompress(raw.split(b"\n", 4)[4]).decode("utf-8").splitlines()
    return {name for name, kind, *_ in (line.split(" ") for line in lines) if kind.startswith("py:")}


def main(site: Path) -> int:
    """Print what is wrong, and how much there is; return the exit code."""
    findings = {
        "broken links": broken_links(site),
        "requests to other hosts": outside_requests(site),
        "public names not in the reference": missing_names(site),
    }
    for kind, places in findings.items():
        for place in places:
            print(f"{kind}: {place}", file=sys.stderr)
    pages, names = len(list(site.rglob("*.html"))), len(list(public_names()))
    counts = ", ".join(f"{kind}: {len(places)}" for kind, places in findings.items())
    print(f"{site}: {pages} pages, {names} public names; {counts}")
    return any(findings.values())


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
