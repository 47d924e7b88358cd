"""The report of the study of rounder vertices: a self-contained HTML page, a figure, the sweep and all results."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tenodesis.control import LawName
from tenodesis.errors import StudyError
from tenodesis.paper import rounder_vertices as vertices
from tenodesis.paper.rounder_vertices import GOOD, LAWS, VertexOutcome, VertexStudy
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Plot, Table, fixed
from tenodesis.report.page import about, json_number, json_text, render, write_columns, write_figure, written

RESULTS_SCHEMA = 1
"""Version of the layout of results.json."""

PAGE, NUMBERS, SWEEP = "vertices.html", "results.json", "sweep.csv"
"""What a study is written as, beside its figure."""
_LINES = ("-", "--", ":")


def write(found: VertexStudy, out: Path) -> None:
    """Write vertices.html, results.json, sweep.csv and figures/ into a folder, atomically.

    Raises StudyError if the folder cannot be written.
    """
    with style.applied(), written(out, StudyError, last=PAGE) as new:
        (new / "figures").mkdir()
        drawn = plot(found)
        drawing = write_figure(drawn, new / "figures")
        write_columns(_sweep(found), new / SWEEP)
        (new / NUMBERS).write_text(json_text(_results(found)), "utf-8")
        page = render(
            "tenodesis.paper",
            "rounder_vertices.html.j2",
            study=found,
            tables=tables(found),
            figure=drawn,
            drawing=drawing,
            answer=vertices.answer(found),
            shift=vertices.pretension_shift(found.inst, found.held_radius),
            good=GOOD,
            before=vertices.BEFORE,
            after=vertices.AFTER,
            states=_states(found),
        )
        (new / PAGE).write_text(page, "utf-8")


def _states(found: VertexStudy) -> list[str]:
    return [f"{math.degrees(state):.4g}°" for state in found.states]


def _sweep(found: VertexStudy) -> dict[str, Array]:
    """Return the sweep by columns: the design's numbers, then what it costs; NaN where a controller faulted."""
    designs = list(found.outcomes)
    outcomes = list(found.outcomes.values())
    columns = {
        "radius [m]": np.array([one.radius for one in designs]),
        "coefficient [1]": np.array([one.coefficient for one in designs]),
        "bending stiffness [N*m^2]": np.array([one.rope.bending_stiffness for one in designs]),
        "load index [1]": np.array([one.surface.load_index for one in designs]),
        "hysteresis [deg]": np.array([one.hysteresis for one in outcomes]),
        "delay [deg]": np.array([one.delay for one in outcomes]),
    }
    for law in LAWS:
        for n, state in enumerate(found.states):
            heading = f"final error {law} at {math.degrees(state):.4g} deg [deg]"
            columns[heading] = np.array([one.final[law][n] for one in outcomes])
    return columns


def _results(found: VertexStudy) -> dict[str, Any]:
    def by_law(one: VertexOutcome) -> dict[str, Any]:
        return {law: [json_number(value) for value in one.final[law]] for law in LAWS}

    return {
        "schema": RESULTS_SCHEMA,
        "about": about(),
        "instrument": found.inst.name,
        "answer": vertices.answer(found),
        "force": found.force,
        "states": [math.degrees(state) for state in found.states],
        "reference_radius": found.reference_radius,
        "radius_limits": {key: json_number(value) for key, value in found.limits._asdict().items()},
        "largest_radius": found.limits.largest,
        "pretension_shift": vertices.pretension_shift(found.inst, found.held_radius),
        "ropes": {rope.name: rope.bending_stiffness for rope in found.ropes},
        "surfaces": {surface.name: surface.load_index for surface in found.surfaces},
        "largest_coefficient": [
            {"rope": rope.name, "radius": radius, "coefficient": json_number(value)}
            for (rope, radius), value in found.largest_coefficient.items()
        ],
        "designs": [
            {
                "radius": design.radius,
                "coefficient": design.coefficient,
                "rope": design.rope.name,
                "surface": design.surface.name,
                "hysteresis": json_number(one.hysteresis),
                "delay": json_number(one.delay),
                "final_error": by_law(one),
            }
            for design, one in found.outcomes.items()
        ],
    }


def tables(found: VertexStudy) -> list[Table]:
    """Return the tables of the page: by radius and rope, and by coefficient."""
    headings = ["lost", "loop", "delay", *(f"paper {state}" for state in _states(found)), "ours"]
    by_radius, reference = [], found.reference_radius
    for surface in found.surfaces:
        for rope in found.ropes:
            for radius, one in zip(found.radii, found.along_radius(rope, surface), strict=True):
                if radius in {reference, found.held_radius}:
                    by_radius.append([surface.name, rope.name, f"{1e3 * radius:.2g}", *_cells(one)])
    by_coefficient = [
        [f"{coefficient:.3g}", *_cells(one)]
        for coefficient, one in zip(found.coefficients, found.along_coefficient(), strict=True)
    ]
    return [
        Table(
            f"Coefficient {found.coefficient:.3g}, present vertices and the largest that the joint holds: angle "
            "lost in the last state with the motors off, loop, delay, final error of the paper’s law by state and the "
            "worst of ours, deg",
            ["surface", "rope", "ρ [mm]", *headings],
            by_radius,
        ),
        Table(
            f"On metal, radius {1e3 * reference:.2g} mm, tendons that spring back: the same by coefficient, deg",
            ["μ", *headings],
            by_coefficient,
        ),
    ]


def _cells(one: VertexOutcome) -> list[str]:
    worst = one.worst("robust")
    return [
        fixed(one.lost[-1]),
        fixed(one.hysteresis),
        fixed(one.delay),
        *(fixed(value) for value in one.final["paper"]),
        "fault" if math.isinf(worst) else fixed(worst),
    ]


def plot(found: VertexStudy) -> Plot:
    """Return the figure: hysteresis and final errors over radius, final errors over the coefficient."""
    chart = Chart(Figure(figsize=(9.6, 7.4), layout="constrained"))
    (first, second), (third, fourth) = chart.figure.subplots(2, 2)
    radii = chart.keep("radius [mm]", 1e3 * np.array(found.radii))
    colors = dict(zip(found.surfaces, style.LOADS, strict=False))
    last = f"at {math.degrees(found.states[-1]):.4g}°"

    def draw(axis: Axes, name: str, of: Any) -> None:
        for surface in found.surfaces:
            for rope, line in zip(found.ropes, _LINES, strict=False):
                values = [of(one) for one in found.along_radius(rope, surface)]
                heading = f"{name}, {surface.name}, {rope.name} [deg]"
                chart.curve(axis, radii, heading, values, line, color=colors[surface], marker="o", ms=3.5, lw=1.5)
        axis.axvline(1e3 * found.limits.largest, color=style.INK, lw=1.0)
        axis.set(xscale="log", xlabel="vertex radius [mm]")
        axis.set_xticks(radii, [f"{value:.2g}" for value in radii], minor=False)
        axis.tick_params(axis="x", rotation=45)
        axis.minorticks_off()

    draw(first, "hysteresis", lambda one: one.hysteresis)
    first.set(ylabel="hysteresis [deg]", title="Loop of output over handle angle")
    first.set_ylim(bottom=0)
    draw(second, "paper", lambda one: abs(one.final["paper"][-1]))
    second.set(ylabel="final error [deg]", title=f"Paper's law {last}")
    draw(third, "robust", lambda one: one.worst("robust"))
    third.set(ylabel="final error [deg]", title="Robust law, worst of the states")
    share = chart.keep("coefficient [1]", np.array(found.coefficients))
    drawn: tuple[tuple[LawName, str, str], ...] = (
        ("paper", "paper's law", style.ANTAGONIST),
        ("robust", "robust law", style.AGONIST),
    )
    for law, name, color in drawn:
        values = [one.worst(law) for one in found.along_coefficient()]
        heading = f"{name} over coefficient [deg]"
        chart.curve(fourth, share, heading, values, color=color, marker="o", ms=3.5, label=name)
    fourth.axvline(found.coefficient, color=style.INK, ls=":", lw=1.0)
    fourth.set(xlabel="vertex coefficient [1]", ylabel="final error [deg]", title="Worst of the states, by coefficient")
    fourth.legend(loc="upper left")
    for axis in (second, third, fourth):
        axis.axhline(GOOD, color=style.REFERENCE, ls="--", lw=1.0)
        axis.set_ylim(0, max(axis.get_ylim()[1], 1.2 * GOOD))
    for surface in found.surfaces:
        for rope, line in zip(found.ropes, _LINES, strict=False):
            first.plot([], [], line, color=colors[surface], label=f"{surface.name}, {rope.name}")
    first.plot([], [], color=style.INK, lw=1.0, label="largest radius that the joint holds")
    handles, names = first.get_legend_handles_labels()
    chart.figure.legend(handles, names, loc="outside upper left", ncols=len(found.surfaces) + 1)
    return chart.plot(
        "vertices",
        f"{found.inst.name} under {found.force:.3g} N, coefficient {found.coefficient:.3g}. The joint holds "
        f"{1e3 * found.limits.largest:.2g} mm; dotted: the coefficient of the file; "
        f"dashed: {GOOD:g}°.",
    )
