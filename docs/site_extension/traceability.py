"""The table equation, functions, tests: from docstrings, header comments and test markers."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
EQUATIONS = range(1, 23)


def tables() -> str:
    """Return the table of the equations, and that of the care points."""
    functions = defaultdict(list)
    for name, text in [*_python_functions(), *_core_functions()]:
        for number in _equations(text):
            functions[number].append(name)
    tests, care = defaultdict(list), defaultdict(list)
    for name, marker, numbers in _marked_tests():
        for number in numbers:
            (tests if marker == "equation" else care)[number].append(name)
    lines = ["| equation | implemented in | tested by |", "|---|---|---|"]
    lines += [f"| {n} | {_cell(functions[n])} | {_cell(tests[n])} |" for n in EQUATIONS]
    lines += ["", "| care point | tested by |", "|---|---|"]
    lines += [f"| [{n}](model.md#care-points) | {_cell(care[n])} |" for n in sorted(care)]
    return "\n".join(lines) + "\n"


def _cell(names: list[str]) -> str:
    return "<br>".join(f"`{name}`" for name in dict.fromkeys(names)) or "–"


def _equations(text: str) -> list[int]:
    """Return the numbers in "eq. 5", "eqs. 1-9" and "eqs. 4, 5"."""
    numbers: list[int] = []
    for group in re.findall(r"\beqs?\. (\d+(?:(?:-|, | and )\d+)*)", text):
        for part in re.split(r", | and ", group):
            first, _, last = part.partition("-")
            numbers += range(int(first), int(last or first) + 1)
    return numbers


def _python_functions() -> Iterator[tuple[str, str]]:
    for module in ("statics.equations", "similarity.pair", "similarity.comparison"):
        tree = ast.parse((ROOT / f"src/tenodesis/{module.replace('.', '/')}.py").read_text("utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                yield (
                    f"tenodesis.{module.partition('.')[0]}.{node.name}",
                    (ast.get_docstring(node) or "").split("\n\n")[0],
                )


def _core_functions() -> Iterator[tuple[str, str]]:
    for header in sorted((ROOT / "include/tenodesis").glob("*.hpp")):
        text = header.read_text("utf-8")
        for match in re.finditer(r"((?:^///[^\n]*\n)+)template <[^\n]*\n(?:  requires[^\n]*\n)?([^\n]*)", text, re.M):
            name = re.search(r"struct (\w+)|(\w+)\(", match[2])
            if name:
                yield f"{header.name}: {name[1] or name[2]}", match[1]


def _marked_tests() -> Iterator[tuple[str, str, list[int]]]:
    for file in sorted((ROOT / "tests/python").glob("test_*.py")):
        for node in ast.parse(file.read_text("utf-8")).body:
            if not isinstance(node, ast.FunctionDef):
                continue
            for decorator in node.decorator_list:
                if isinstance(decorator, ast.Call) and isinstance(decorator.func, ast.Attribute):
                    kind = decorator.func.attr
                    if kind in ("equation", "care"):
                        numbers = [ast.literal_eval(argument) for argument in decorator.args]
                        yield f"{file.stem}::{node.name}", kind, numbers
