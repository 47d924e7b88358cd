"""Show executed cells as what they are: a shell command, a file, or Python."""

from pathlib import PurePath
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_LANGUAGES = {".toml": "toml", ".csv": "text", ".py": "python", ".c": "c"}


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the transformation."""
    app.connect("doctree-read", _show)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _show(app: Sphinx, document: nodes.document) -> None:
    for block in document.findall(nodes.literal_block):
        first, _, rest = block.astext().partition("\n")
        words = first.split()
        if words[:1] == ["%%bash"]:
            _replace(block, rest, "sh")
        elif words[:1] == ["%%writefile"]:
            language = _LANGUAGES.get(PurePath(words[1]).suffix, "text")
            _replace(block, rest, language)
            name = nodes.paragraph("", "", nodes.literal(text=words[1]), classes=["file-name"])
            block.parent.insert(block.parent.index(block), name)
            _without_output(block)


def _without_output(block: nodes.literal_block) -> None:
    """Leave out that a file is written."""
    cell = block.parent.parent
    for output in [child for child in cell.children if "cell_output" in child.get("classes", ())]:
        cell.remove(output)


def _replace(block: Any, text: str, language: str) -> None:
    block.rawsource = text
    block.children = [nodes.Text(text)]
    block["language"] = language
