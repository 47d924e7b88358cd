"""Write what is generated, not typed: pictures of the pages, and the report's figures in docs/results.json."""

import sys
import tempfile
from pathlib import Path

import conventions
import dimensions
import numpy as np
import picture

from tenodesis import instrument
from tenodesis.paper import run
from tenodesis.paper.context import Context
from tenodesis.report import routing, space

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "studies"))

import figures  # noqa: E402


def main(folder: Path = ROOT) -> None:
    """Draw every picture below a folder, as it would stand in the repository."""
    (folder / "docs").mkdir(parents=True, exist_ok=True)
    picture.draw(folder / "docs/picture.svg")
    dimensions.draw(folder / "docs/dimensions.svg")
    conventions.draw(folder / "docs/conventions.svg")
    dissector = instrument.expanded("maryland-dissector")
    routing.write(folder / "docs/routing.svg", dissector)
    space.write(folder / "docs/posture.svg", dissector, np.radians([25, 50, 10]))


def report(context: Context) -> figures.FigureTable:
    """Return the results of a report as a table of figures."""
    headings = ("value", "value", "", ".4g"), ("unit", "unit"), ("what", "what it is"), ("published", "published")
    rows = {}
    for name, result in sorted(context.results.items()):
        printed = "" if result.published is None else f"{result.published.value:g} ({result.published.source})"
        rows[name] = [result.value, result.unit, result.description, printed]
    return figures.FigureTable("tenodesis bench", "name", [figures.Heading(*one) for one in headings], rows)


if __name__ == "__main__":
    main()
    with tempfile.TemporaryDirectory() as out:
        done = run(instrument.load("real-size"), instrument.load("scaled-up"), Path(out))
    figures.keep("bench", report(done))
