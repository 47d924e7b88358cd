"""Pages that stand elsewhere in the repository, and links that lead out of the documentation's folder.

A page that says {{page ../NAME.md}} is that file. A link to a folder of the repository is shown as its text, one to a
file is a download.
"""

import re
from pathlib import Path

from sphinx.application import Sphinx

_PAGES = {
    "../firmware/README.md": "firmware.md",
    "../CONTRIBUTING.md": "contributing.md",
    "../CHANGELOG.md": "changelog.md",
    "../SECURITY.md": "security.md",
    "../README.md": "index.md",
}
_LINK = re.compile(r"\[([^\]]*)\]\(([^)#:]+)(#[^)]*)?\)")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the replacement."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _read(app: Sphinx, page: str, source: list[str]) -> None:
    docs = Path(app.srcdir)
    elsewhere = re.fullmatch(r"\{\{page (\S+)\}\}\s*", source[0])
    origin = (docs / (elsewhere[1] if elsewhere else page)).parent
    if elsewhere:
        source[0] = (docs / elsewhere[1]).read_text("utf-8")

    def link(match: re.Match[str]) -> str:
        text, target, anchor = match[1], (origin / match[2]).resolve(), match[3] or ""
        inside = target.is_relative_to(docs)
        if not target.exists() or (inside and not elsewhere):
            return match[0]
        path = target.relative_to(docs if inside else docs.parent).as_posix()
        path = path if inside else _PAGES.get(f"../{path}", f"../{path}")
        up = "" if elsewhere else "../" * page.count("/")
        return text if target.is_dir() else f"[{text}]({up}{path}{anchor})"

    source[0] = _LINK.sub(link, source[0])
