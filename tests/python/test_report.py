"""Claims about how results are shown: numbers, tables that record results, charts that keep their curves, pages."""

import csv
from pathlib import Path

import numpy as np
import pytest

from tenodesis.report import page, style
from tenodesis.report.content import Chart, Published, Result, ResultColumn, ResultTable, fixed, number


def test_numbers_are_written_for_reading() -> None:
    assert [fixed(value) for value in (1.005, -2.0, -1e-12, np.nan, np.inf)] == ["1.00", "−2.00", "0.00", "–", "–"]
    assert fixed(12.34, 0) == "12"
    assert [number(value) for value in (0.0, 25.0, -0.48119, np.nan)] == ["0", "25", "−0.4812", "–"]
    assert number(-1.2e-9) == "−1.2 × 10<sup>−9</sup>"


def test_a_row_of_a_table_is_also_its_results() -> None:
    results: dict[str, Result] = {}

    def record(key: str, value: float, unit: str, description: str, published: Published | None = None) -> float:
        results[key] = Result(key, value, unit, description, published)
        return value

    columns = (
        "force",
        ResultColumn("error [°]", "error.at_{force:g}N", "deg", "Error under {force:g} N", digits=1),
        ResultColumn("time [s]", "time.at_{force:g}N", "s", "Time under {force:g} N", optional=True),
        ResultColumn("met", form=lambda value: "yes" if value else "no"),
    )
    table = ResultTable("Errors", columns, record)
    printed = Published(2.0, "Fig. 1")
    table.row("0.5 N", (2.125, printed), np.nan, 1, force=0.5)
    table.row("1 N", np.nan, 3.0, 0, force=1.0)
    assert table.columns == ["force", "error [°]", "time [s]", "met"]
    assert table.rows == [["0.5 N", "2.1", "–", "yes"], ["1 N", "–", "3.00", "no"]]
    assert list(results) == ["error.at_0.5N", "error.at_1N", "time.at_1N"]
    assert results["error.at_0.5N"] == Result("error.at_0.5N", 2.125, "deg", "Error under 0.5 N", printed)
    assert results["error.at_0.5N"].residual == pytest.approx(0.125)


def test_a_curve_is_drawn_and_kept_for_the_csv_file(tmp_path: Path) -> None:
    with style.applied():
        fig, (axis,) = style.figure()
        chart = Chart(fig)
        x = chart.keep("x [mm]", [0, 1, 2])
        chart.curve(axis, x, "y [N]", [1.0, np.nan, 3.0], "--", color=style.ACCENT)
        plot = chart.plot("name", "A curve")
        svg = page.write_figure(plot, tmp_path)
    assert np.array_equal(axis.lines[0].get_ydata(), plot.curves["y [N]"], equal_nan=True)
    page.write_columns({**plot.curves, "short [s]": [0.5]}, tmp_path / "name.csv")
    rows = list(csv.reader((tmp_path / "name.csv").open()))
    assert rows == [["x [mm]", "y [N]", "short [s]"], ["0", "1", "0.5"], ["1", "", ""], ["2", "3", ""]]
    assert svg.startswith("<svg")
    assert 'id="name-' in svg
    assert {path.name for path in tmp_path.iterdir()} == {"name.svg", "name.png", "name.csv"}
