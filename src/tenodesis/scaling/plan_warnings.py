"""What a workshop must not overlook."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tenodesis.scaling.plan_text import degrees, plain, short_of, signed, told
from tenodesis.similarity import SimilarityError

if TYPE_CHECKING:
    from tenodesis.scaling.design import Design

_SLACK_OFF = 0.005
"""Share that the pretension may differ from the similar one without a word."""

_ROUNDING = 1e-9


def warnings(design: "Design", error: SimilarityError) -> Iterator[str]:
    """Yield what is not as a workshop would expect, a sentence each."""
    constraints, choice = design.catalogue.constraints, design.choice
    similar = design.real_size.pretension * design.comparison.tension_factor
    off = design.scaled_up.pretension / similar - 1 if similar else 0.0
    if abs(off) > _SLACK_OFF:
        yield (
            f"Pretension is {told(design.scaled_up.pretension, 'N', 3)}, {plain(abs(100 * off), 2)} % "
            f"{'below' if off < 0 else 'above'} the similar {told(similar, 'N', 3)}: tendons do not go slack at "
            "similar loads."
        )
    for test in design.tests:
        share = test.error / test.real_force
        if abs(share) > constraints.force_tolerance:
            yield (
                f"What hangs for {told(test.real_force, 'N', 3)} real-size is off by {signed(100 * share, 2)} %, more "
                f"than {plain(100 * constraints.force_tolerance, 2)} %."
            )
    spare = choice.load_cell.range / design.largest_tension if design.largest_tension else math.inf
    for what, margin, asked in (
        ("The rope breaks", design.objectives.tension_margin, constraints.tension_margin),
        ("The load cells end", spare, constraints.load_cell_margin),
    ):
        # A design at its limit is off by rounding at most.
        if margin < asked * (1 - _ROUNDING):
            yield f"{what} at {short_of(margin, asked)} × the largest tension; {plain(asked, 9)} × is asked for."
    if choice.encoder is None:
        yield f"No encoder of the catalogue fits a distal radius of {told(choice.distal.radius, 'mm', 4, 'm')}."
    if error.held_by_one:
        yield (
            f"On {plain(100 * error.held_by_one, 2)} % of the working range one of the two snaps through and the other "
            f"does not; with a tip at its stop there, the error goes up to {degrees(error.largest_snapped)}."
        )
    both = error.unsolved - error.held_by_one
    if both > _ROUNDING:
        yield f"On {plain(100 * both, 2)} % of the working range neither holds the load."
