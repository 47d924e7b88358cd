"""Show signatures with types as the source has them, for a person: `ArrayLike`, not the union that it stands for."""

import ast
import inspect
import sys
import textwrap
from collections.abc import Mapping
from enum import Enum
from functools import cache
from typing import Any

from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the hooks of autodoc."""
    app.connect("autodoc-skip-member", _fields_of_tuples)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-process-docstring", _property_type)
    app.connect("autodoc-process-docstring", _meaning_of_data)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fields_of_tuples(  # noqa: PLR0917 - autodoc's arguments
    app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any
) -> bool | None:
    """Leave out fields of a named tuple that have no text of their own: the signature shows them."""
    return True if (getattr(thing, "__doc__", None) or "").startswith("Alias for field number") else None


def _signature(  # noqa: PLR0917 - autodoc's arguments
    app: Sphinx, what: str, name: str, thing: Any, options: Any, arguments: str | None, result: str | None
) -> tuple[str | None, str | None] | None:
    if what == "class" and inspect.isclass(thing):
        return _of_class(thing)
    node = _source(thing)
    if not isinstance(node, ast.FunctionDef):
        return None
    names = inspect.unwrap(thing).__globals__
    result = ast.unparse(_Linked(names).visit(node.returns)) if node.returns else None
    return _arguments(_Linked(names).visit(node), bound=what == "method"), result


class _Linked(ast.NodeTransformer):
    """Writes a class of this package with its module, which the page shows as a link without it."""

    def __init__(self, names: Mapping[str, Any]) -> None:
        self._names = names

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Return the name with its module, if it is a class of this package."""
        found = self._names.get(node.id)
        inside = inspect.isclass(found) and found.__module__.startswith("tenodesis")
        return ast.Name(f"{found.__module__}.{found.__qualname__}") if inside else node


def _of_class(kind: type) -> tuple[str | None, None]:
    """Return the fields of a record, or the arguments of a class's own __init__; of others and files, nothing."""
    node = _source(kind)
    if issubclass(kind, BaseModel | Enum | BaseException) or not isinstance(node, ast.ClassDef):
        return "", None
    for item in node.body:
        if isinstance(item, ast.FunctionDef) and item.name == "__init__":
            return _arguments(_Linked(vars(sys.modules[kind.__module__])).visit(item), bound=True), None
    fields = [item for item in node.body if isinstance(item, ast.AnnAssign) and "ClassVar" not in ast.unparse(item)]
    shown = [
        f"{ast.unparse(item.target)}: {ast.unparse(item.annotation)}"
        + (f" = {ast.unparse(item.value)}" if item.value is not None else "")
        for item in fields
    ]
    return f"({', '.join(shown)})" if shown else "", None


def _property_type(  # noqa: PLR0917 - autodoc's arguments
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    node = _source(thing.fget) if isinstance(thing, property) else None
    if isinstance(node, ast.FunctionDef) and node.returns and lines:
        lines[0] = f"*{ast.unparse(node.returns)}*: {lines[0]}"


def _meaning_of_data(  # noqa: PLR0917 - autodoc's arguments
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    """Give a constant or an alias the text that stands below it where it is defined."""
    package, _, short = name.rpartition(".")
    if what in ("data", "type"):
        lines[:] = _texts_of_data(package).get(short, [])


@cache
def _texts_of_data(package: str) -> dict[str, list[str]]:
    texts: dict[str, list[str]] = {}
    within = [name for name in sys.modules if name == package or name.startswith(f"{package}.")]
    for name in [name for name in within if str(sys.modules[name].__file__).endswith(".py")]:
        found = ModuleAnalyzer.for_module(name).find_attr_docs()
        texts |= {short: text for (owner, short), text in found.items() if not owner}
    return texts


def _arguments(node: ast.FunctionDef, *, bound: bool) -> str:
    decorators = {ast.unparse(decorator) for decorator in node.decorator_list}
    if bound and "staticmethod" not in decorators:
        (node.args.posonlyargs or node.args.args)[:1] = []
    return f"({ast.unparse(node.args)})"


def _source(thing: Any) -> ast.stmt | None:
    try:
        text = inspect.getsource(inspect.unwrap(thing))
    except (TypeError, OSError):
        return None
    return ast.parse(textwrap.dedent(text)).body[0]
