"""Write what is generated, not typed: tables and figures in docs/."""

import ast
import re
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import conventions
import dimensions
import keys
import numpy as np
import picture

from tenodesis import instrument
from tenodesis.paper import run
from tenodesis.paper.context import Context
from tenodesis.report import routing, space

ROOT = Path(__file__).parents[1]
EQUATIONS = range(1, 23)


def main(folder: Path = ROOT) -> None:
    """Write every generated file below a folder, as it would stand in the repository; but for the results' table."""
    (folder / "docs").mkdir(parents=True, exist_ok=True)
    (folder / "docs/traceability.md").write_text(traceability(), "utf-8")
    (folder / "docs/keys.md").write_text(keys.page(), "utf-8")
    picture.draw(folder / "docs/picture.svg")
    dimensions.draw(folder / "docs/dimensions.svg")
    conventions.draw(folder / "docs/conventions.svg")
    dissector = instrument.expanded("maryland-dissector")
    routing.write(folder / "docs/routing.svg", dissector)
    space.write(folder / "docs/posture.svg", dissector, np.radians([25, 50, 10]))


def traceability() -> str:
    """Return the table equation, functions, tests, read from docstrings, header comments and test markers."""
    functions = defaultdict(list)
    for name, text in [*_python_functions(), *_core_functions()]:
        for number in _equations(text):
            functions[number].append(name)
    tests, care = defaultdict(list), defaultdict(list)
    for name, marker, numbers in _marked_tests():
        for number in numbers:
            (tests if marker == "equation" else care)[number].append(name)
    lines = [
        "# Traceability",
        "",
        "Made by `make docs` from docstrings, header comments and test markers; do not edit.",
        "",
        "| equation | implemented in | tested by |",
        "|---|---|---|",
    ]
    lines += [f"| {n} | {_cell(functions[n])} | {_cell(tests[n])} |" for n in EQUATIONS]
    lines += ["", "| care point | tested by |", "|---|---|"]
    lines += [f"| [{n}](model.md#care-points) | {_cell(care[n])} |" for n in sorted(care)]
    return "\n".join(lines) + "\n"


def bench() -> Context:
    """Run the bench on the paper's instruments, with as few seeds as name every result."""
    with tempfile.TemporaryDirectory() as out:
        return run(instrument.load("real-size"), instrument.load("scaled-up"), Path(out), seeds=1)


def results(context: Context) -> str:
    """Return the table of the results of a bench: their names, not their values."""
    lines = [
        "# Results by name",
        "",
        "Made by `make docs`; do not edit. `tenodesis bench` writes `out/results.json`: `schema` (version of this",
        "layout), `about` (versions), `instrument`, `scaled_up`, and `results`, where each name below holds `value`",
        "(null where there is none), `unit`, `description` and, for what the paper prints, `published`, `residual` and",
        "`source`. Loads and angles in a name are the instrument's own conditions, so another instrument has others.",
        "",
        "| name | unit | what it is | published |",
        "|---|---|---|---|",
    ]
    for key, result in sorted(context.results.items()):
        printed = "" if result.published is None else f"{result.published.value:g} ({result.published.source})"
        lines.append(f"| `{key}` | {result.unit} | {result.description} | {printed} |")
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


if __name__ == "__main__":
    main()
    (ROOT / "docs/results.md").write_text(results(bench()), "utf-8")
