"""What each mechanism of the robust law earns: each taken out in turn, by constants that keep it from acting.

Peer: the law as it is, at the reference work of studies/tuning.py. It takes
the same build: ``pip install . -C cmake.define.TENODESIS_TUNABLE=ON``.
"""

from typing import Any

import law
import tuning

from tenodesis import _core
from tenodesis.control import TUNING
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, Rows

NEVER = 1e9
MECHANISMS: dict[str, dict[str, float]] = {
    "nothing": {},
    "friction's scale": {"least_friction": 1, "most_friction": 1},
    "compliance": {"most_compliance": 1},
    "gains of the cells": {"most_gain_difference": 0},
    "shares of the compliance": {"share_std": 0},
    "measurements refused": {"outlier": NEVER},
    "forgetting": {"forgetting": 0},
    "reversals gate slip": {"reversing_share": 0, "surely_reversed": 0},
    "play before slip is firm": {"firm_run": 0},
    "intent behind a tremor": {"tremor_limit": 0},
    "slow strokes on target": {"slow_stroke": 1},
    "corrections between strokes": {"correction_time": 2e-3},
    "a growing dead band": {"most_tolerance": 1},
    "continued strokes": {"transient_time": 0},
    "breakaway as the hand reverses": {"breakaway_angle": 0},
    "gain by reversals": {"few_reversals": NEVER, "many_reversals": 2 * NEVER},
    "alternation": {"alternation_longest": 0},
    "alternation and the envelope's bounds": {"notable_angle": NEVER},
}
"""What is taken out, and the constants by which it never acts."""
SEVERAL = ["four", "bent-two", "bent-front", "bent-rough", "two-front", "two-gains", "rough-soft", "rough-gains", "all"]
"""Rows of studies/plants.py in which several differences meet"""
CASES = {"plants": campaign.cases(row=SEVERAL)}
"""Cases in the place of the reference work's own, whose one plant has to be quick: it is run for every constant"""
PARTS = ("plants", "random", "changing", "alternating", "stopped", "tremor")


def trial(mechanism: str, parts: list[str]) -> dict[str, Any]:
    """Return the figures of the reference work without a mechanism."""
    changed = MECHANISMS[mechanism]
    for name, value in changed.items():
        _core.tune(name, value)
    try:
        return {name: value for part in parts for name, value in tuning.figures_of(part, CASES.get(part)).items()}
    finally:
        for name in changed:
            _core.tune(name, TUNING[name].value)


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--mechanisms", nargs="+", choices=[*MECHANISMS], metavar="NAME", default=[*MECHANISMS])
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=[*PARTS], help="of the reference work")
    options = parser.parse_args()
    tuning.check_build()
    cases = campaign.cases(mechanism=options.mechanisms, parts=[options.parts])
    rows = campaign.run(trial, cases, "ablation", results=options.results)
    groups: dict[Any, Rows] = rows.by("mechanism")
    columns = [
        Column(name, name) if one.tolerance < 1 else Column(f"{name}, ", name, form=".0f")
        for name, one in tuning.FIGURES.items()
        if one.part in options.parts
    ]
    law.show(options, "ablation", groups, columns, "without")


if __name__ == "__main__":
    main()
