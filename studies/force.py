"""How well the observer knows the force at the tip, resting and moving, and whether its interval covers the truth.

On the plants of :mod:`plants`, which share no code with the twin: 1.5 N on the scaled-up instrument in the four states
of Fig. 15, friction assumed as 0.7, 1 and 1.3 times what it is.

Peer: eq. 1 with the tensions that the load cells read, at the true output angle.
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plants import LAST, LOADED, ROWS, Case, Trace, cases_of, run

from tenodesis.paper.tip_force import Judged, by_tensions, drawing, judge
from tenodesis.report import style

Array = NDArray[np.float64]

ROWS_OF_FORCE = ("nothing", "two", "front", "rough", "four", "gains", "soft", "base", "two-front", "real", "real-two")
SECONDS = 8.0
SWAY, RATE = np.radians(3), 0.5  # of the handle, Hz
SETTLED = 0.3  # s after the load


def plain(case: Case, trace: Trace) -> Array:
    """Tip force by eq. 1 from the tensions as read, N."""
    return by_tensions(case.known, trace.tip, trace.read.T)


def assess(cases: Sequence[Case], traces: Sequence[Trace], begin: float, end: float) -> Judged:
    """Judge the estimates between two times, s."""
    within = (traces[0].time > begin) & (traces[0].time <= end)
    off = [trace.force[within] - case.force for case, trace in zip(cases, traces, strict=True)]
    missed = [plain(case, one)[within] - case.force for case, one in zip(cases, traces, strict=True)]
    return judge(off, [trace.force_std[within] for trace in traces], missed)


def draw(path: Path, case: Case) -> None:
    """Draw the force of a case over time: load, estimate with its interval, eq. 1."""
    (trace,) = run([case], SECONDS)
    every = slice(2000, None, 20)
    load = np.where(trace.time > LOADED, case.force, 0.0)
    with style.applied():
        chart = drawing(*(one[every] for one in (trace.time, load, trace.force, trace.force_std, plain(case, trace))))
        chart.figure.savefig(path, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], default=ROWS_OF_FORCE, metavar="ROW")
    parser.add_argument("--figure", type=Path, help="draw one case of two vertices a joint into this SVG file")
    options = parser.parse_args()
    begun = time.perf_counter()
    cases: list[Case] = []
    places: dict[tuple[str, str], slice] = {}
    for name in options.rows:
        own = [case for case in cases_of(ROWS[name]) if case.known is not None]
        works = {
            "rest, before a stroke": [case._replace(law="off") for case in own],
            "rest, after strokes": own,
            "moving": [case._replace(tremor=float(SWAY), rate=RATE) for case in own],
        }
        for work, these in works.items():
            places[name, work] = slice(len(cases), len(cases) + len(these))
            cases += these
    traces = run(cases, SECONDS)
    print(f"  {'what differs':52s}{'':24s}{'error':>8s}{'worst':>8s}{'stated':>8s}{'covered':>9s}{'eq. 1':>8s}   N")
    for (name, work), place in places.items():
        begin = LOADED + SETTLED if work != "rest, after strokes" else SECONDS - LAST
        one = assess(cases[place], traces[place], begin, SECONDS)
        print(
            f"  {ROWS[name].words:52s}{work:24s}{one.error:8.3f}{one.worst:8.3f}{one.deviation:8.3f}"
            f"{100 * one.covered:8.1f}%{one.plain:8.3f}"
        )
    if options.figure:
        case = next(case for case in cases_of(ROWS["two"]) if np.isclose(case.output, np.radians(67)))
        draw(options.figure, case)
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
