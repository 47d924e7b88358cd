"""What each constant of the controller is worth: each of include/tenodesis/tuning.hpp, times a half and one and a half.

Peer: the constant as it is. A constant that changes none of the figures by more than their own tolerance (what one case
more or less, or a hundredth of a degree, changes) is worth nothing here, and should go, or has another reason. It takes
another build: ``pip install . -C cmake.define.TENODESIS_TUNABLE=ON``.
"""

import functools
import sys
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import changes
import harm
import homing
import law
import numpy as np
import plants
import tremor

from tenodesis import _core
from tenodesis.control import TUNING
from tenodesis.errors import ArgumentError
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, Rows

FACTORS = (0.5, 1.5)
SEED = 101
OF_FAULTS = {"watch_window", "watch_moment", "long_run", "drive_gain_error", "transient_time", "hanging"}
ALTERNATING = campaign.cases(
    instrument=["scaled-up", "real-size"], angle=[33.0, 80.0], share=[0.25, 0.5], period=[0.4, 1.5]
)
"""Of studies/changes.py"""


class Figure(NamedTuple):
    """A figure of the reference work: of which part, how its rows are summed up, and what of it counts as a change."""

    part: str
    sums: Callable[[Rows], float]
    tolerance: float


def mean(key: str) -> Callable[[Rows], float]:
    return lambda rows: float(np.mean(np.asarray(rows[key], float)))


def count(test: Callable[[Mapping[str, Any]], Any]) -> Callable[[Rows], float]:
    return lambda rows: float(sum(bool(test(row)) for row in rows))


FIGURES = {
    "plants RMS": Figure("plants", mean("final_rms"), 0.01),
    "plants worst": Figure("plants", lambda rows: float(np.max(rows["final_worst"])), 0.05),
    "plants swing": Figure("plants", mean("swing_since"), 0.02),
    "random RMS": Figure("random", mean("rms"), 0.01),
    "random harmful": Figure("random", count(lambda row: row["harmful"]), 1),
    "changing RMS": Figure("changing", mean("rms"), 0.02),
    "changing harmful": Figure("changing", count(lambda row: row["harmful"]), 2),
    "alternating beyond": Figure("alternating", count(lambda row: row["more_rms"] > 0.5 or row["more_peak"] > 2), 1),
    "alternating RMS": Figure("alternating", mean("rms"), 0.05),
    "stopped end": Figure("stopped", mean("end"), 0.02),
    "tremor beyond": Figure("tremor", count(lambda row: row["more"] > tremor.MORE), 1),
    "tremor swing": Figure("tremor", mean("swing"), 0.01),
    "faults: after": Figure("faults", mean("after_off"), 0.1),
    "faults named": Figure("faults", count(lambda row: row["named"]), 0),
    "homing right": Figure("homing", count(lambda row: row["right"]), 0),
    "homing apart": Figure("homing", mean("apart"), 0.002),
    "homing seconds": Figure("homing", mean("seconds"), 0.1),
}


def parts() -> dict[str, tuple[Callable[..., Any], list[dict[str, Any]]]]:
    """Return the reference work: a function and its cases, of each part."""
    names = [*law.RATED]
    work = {"exact": [False], "assistance": [None]}
    random = [case | {"seed": SEED} for case in campaign.cases(number=range(12), instrument=names, **work)]
    kinds = campaign.cases(kind=[*harm.KINDS], seed=[SEED], number=[0], instrument=names, **work)
    return {
        "plants": (plants.judge, campaign.cases(row=["all"])),
        "random": (harm.trial, random),
        "changing": (harm.trial, [case | {"changing": True} for case in random]),
        "alternating": (changes.trial, [case | {"scene": "alternating"} for case in ALTERNATING]),
        "stopped": (changes.trial, changes.cases("stopped", names[:1])[::2]),
        "tremor": (
            tremor.trembling,
            campaign.cases(
                instrument=names, angle=[33.0, 67.0], load=[0.0, 1.0], amplitude=[0.1, 0.3], frequency=[8.0]
            ),
        ),
        "faults": (harm.trial, kinds),
        "homing": (homing.trial, campaign.cases(name=names, wrong=[True, False], number=range(40), currents=[False])),
    }


def order(constant: str) -> list[str]:
    """Return the parts whose figures a constant may change, those first in which it is most likely to, or quickest."""
    if constant.startswith("homing_"):
        return ["homing"]
    parts = ["stopped", "tremor", "random", "alternating", "changing", "plants"]
    if constant.startswith("alternation_"):
        parts.sort(key="alternating".__ne__)
    return ["faults", *parts] if constant in OF_FAULTS else parts


def figures_of(part: str, cases: list[dict[str, Any]] | None = None) -> dict[str, float]:
    """Return the figures of a part with the constants as they are now, or those of other cases of the same kind."""
    run, own = parts()[part]
    rows = Rows(case | metrics for case in cases or own if (metrics := run(**case)) is not None)
    return {name: one.sums(rows) for name, one in FIGURES.items() if one.part == part}


peer = functools.cache(figures_of)
"""The figures of a part with every constant as it is; to be asked before one is changed"""


def trial(constant: str, factor: float) -> dict[str, Any]:
    """Return which figures of the reference work a constant changes when it is so many times what it is.

    Parts are run until one has changed.
    """
    value = TUNING[constant].value
    for part in order(constant):
        before = peer(part)
        _core.tune(constant, value * factor)
        try:
            after = figures_of(part)
        except ArgumentError:
            return {"changes": "makes no controller"}
        finally:
            _core.tune(constant, value)
        changes_of = [
            f"{name} {before[name]:.3g} -> {after[name]:.3g}"
            for name in before
            if abs(after[name] - before[name]) > FIGURES[name].tolerance
        ]
        if changes_of:
            return {"changes": "; ".join(changes_of)}
    return {"changes": "nothing"}


def check_build() -> None:
    if not hasattr(_core, "tune"):
        sys.exit("The constants are fixed in this build; run: pip install . -C cmake.define.TENODESIS_TUNABLE=ON")


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--constants", nargs="+", choices=[*TUNING], metavar="NAME", default=[*TUNING])
    options = parser.parse_args()
    check_build()
    cases = campaign.cases(constant=options.constants, factor=FACTORS)
    rows = campaign.run(trial, cases, "tuning", results=options.results)
    columns = [Column("changes", lambda one: one[0]["changes"], form="")]
    law.show(options, "tuning", rows.by("constant", "factor"), columns, ("constant", "times"))


if __name__ == "__main__":
    main()
