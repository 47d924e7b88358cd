"""The tables of a workshop plan that say how similar the two are, what they do not share, and what that costs."""

import math
from typing import TYPE_CHECKING

from tenodesis.report.content import fixed
from tenodesis.scaling.plan_tables import Table
from tenodesis.scaling.plan_text import NO_ERROR, SPACE, degrees, factor, more, plain, symbols
from tenodesis.similarity import GRID, Comparison, Group, SimilarityError

if TYPE_CHECKING:
    from tenodesis.scaling.design import Design

_IN_MOTION = ("motor", "inertia")
"""Kinds of groups that a held instrument does not feel."""

STOPPED = "a snapped tip at its stop"
"""How a tip that snaps through counts in what a design is judged by."""

_ALIKE = 1e-4
"""Relative difference of two groups that a workshop calls none."""

_WORTH_A_WORD = 0.02
"""Share of the error below which a cause is not named."""


def similarity(design: "Design", error: SimilarityError, drawings: int) -> Table:
    """Return how large the similarity error is, where it is largest, and which groups cause it.

    Where the prototype alone snaps through, the error is told with it at its stop too, as a design is judged by.
    """
    at_rest = design.comparison.error_at_rest(pretension=design.scaled_up.pretension)
    held = ", where both hold" if error.held_by_one else ""
    rows = [
        (f"without friction{held}", degrees(error.largest), degrees(error.rms)),
        ("with friction, at rest", degrees(at_rest.largest), degrees(at_rest.rms)),
    ]
    if error.held_by_one:
        rows.insert(1, (f"without friction, {STOPPED}", degrees(error.largest_snapped), degrees(error.rms_snapped)))
    return Table(
        f"Similarity error, up to {plain(design.comparison.largest_force, 3)}{SPACE}N real-size",
        ("", "largest", "root mean square"),
        tuple(rows),
        note=f"output angle, scaled-up minus real-size{'' if held else ', where both hold'}; {_cause(design, error)}",
        left_out="; ".join(more(3 - drawings, "drawing")),
    )


def _cause(design: "Design", error: SimilarityError) -> str:
    """Return where the error is largest and which groups make it."""
    try:
        found = design.comparison.causes(pretension=design.scaled_up.pretension, grid=GRID)
    except ValueError:
        return f"worst at {_place(*error.worst)}"
    if abs(found.error) < NO_ERROR:
        return "none worth a cause"
    parts = [
        f"{symbols(cause.name)} {'+' if cause.at_worst > 0 else ''}{plain(cause.at_worst, 2)}°"
        for cause in found.causes
        if abs(cause.at_worst) > _WORTH_A_WORD * abs(found.error)
    ]
    return f"worst at {_place(found.place.handle_angle, found.place.force)}, caused by {', '.join(parts)}"


def _place(handle_angle: float, force: float) -> str:
    return f"handle {fixed(math.degrees(handle_angle), 1)}°, {plain(force, 3)}{SPACE}N real-size"


def groups(comparison: Comparison, most: int) -> Table:
    """Return which groups do not match, and in its note which do, and which are made to."""
    imposed = [symbols(group.name) for group in comparison.groups if group.imposed]
    there = [group for group in comparison.groups if (group.real_size or group.scaled_up) and not group.imposed]
    alike = [symbols(group.name) for group in there if _matches(group)]
    others = [group for group in there if not _matches(group)]
    held = [group for group in others if group.kind not in _IN_MOTION]
    moved = [
        f"{symbols(group.name)} × {factor(group.ratio)}".replace(" ", SPACE)
        for group in others
        if group.kind in _IN_MOTION
    ]
    rows = tuple(
        (symbols(group.name), group.kind, plain(group.real_size, 3), plain(group.scaled_up, 3), factor(group.ratio))
        for group in held[:most]
    )
    notes = [
        f"matching: {', '.join(alike) or 'none'}",
        f"made equal by the factors of force and time: {', '.join(imposed)}",
    ]
    if moved:
        notes.append(f"not matching, in motion only: {', '.join(moved)}")
    return Table(
        "Groups that do not match",
        ("", "", "real-size", "scaled-up", "ratio"),
        rows,
        texts=2,
        note="; ".join(notes),
        left_out="; ".join(more(len(held) - most, "further group")),
    )


def _matches(group: Group) -> bool:
    return group.matches or abs(group.ratio - 1) < _ALIKE
