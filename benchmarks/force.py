"""How well the observer knows the force at the tip, resting and moving, and whether its interval covers the truth.

On the plants of :mod:`plants`, which share no code with the twin: 1.5 N on the scaled-up instrument in the four states
of Fig. 15, friction assumed as 0.7, 1 and 1.3 times what it is.

Peer: eq. 1 with the tensions that the load cells read, at the true output angle.
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from plants import LAST, LOADED, ROWS, Case, Trace, cases_of, rms, run

Array = NDArray[np.float64]

ROWS_OF_FORCE = ("nothing", "two", "front", "rough", "four", "gains", "soft", "base", "two-front", "real", "real-two")
SECONDS = 8.0
SWAY, RATE = np.radians(3), 0.5  # of the handle, Hz
SETTLED = 0.3  # s after the load
WITHIN = 1.96  # deviations of an interval of 95 %


class Judged(NamedTuple):
    """Errors of the force over cases, N."""

    error: float
    """RMS"""
    worst: float
    deviation: float
    """RMS of what the observer states"""
    covered: float
    """Share of time within its interval of 95 %"""
    by_cells: float
    """RMS of eq. 1 with proximal tensions"""


def by_cells(case: Case, trace: Trace) -> Array:
    """Tip force by eq. 1 from the tensions as read, N."""
    plant = case.plant
    arm = plant.distal_radius * (np.cos(trace.tip / 2) if plant.gears else 1.0)
    lever = plant.tip_length + (arm if plant.gears else 0.0)
    return np.asarray((trace.read[0] - trace.read[1]) * arm / lever, float)


def judge(cases: Sequence[Case], traces: Sequence[Trace], begin: float, end: float) -> Judged:
    """Judge the estimates between two times, s."""
    within = (traces[0].time > begin) & (traces[0].time <= end)
    off = np.array([trace.force[within] - case.force for case, trace in zip(cases, traces, strict=True)], float)
    std = np.array([trace.force_std[within] for trace in traces], float)
    plain = np.array([by_cells(case, one)[within] - case.force for case, one in zip(cases, traces, strict=True)])
    covered = float((np.abs(off) <= WITHIN * std).mean())
    return Judged(rms(off), float(np.abs(off).max()), rms(std), covered, rms(plain))


def draw(path: Path, case: Case) -> None:
    """Draw the force of a case over time: load, estimate with its interval, eq. 1."""
    import matplotlib as mpl  # noqa: PLC0415 - not needed for the table
    from matplotlib.figure import Figure  # noqa: PLC0415

    mpl.rcParams["svg.hashsalt"] = "force"
    (trace,) = run([case], SECONDS)
    every = slice(None, None, 20)
    at, estimate = trace.time[every], trace.force[every]
    width = WITHIN * trace.force_std[every]
    figure = Figure(figsize=(7.0, 2.8), layout="constrained")
    axes = figure.subplots()
    axes.fill_between(at, estimate - width, estimate + width, color="#4477aa", alpha=0.25, linewidth=0, label="95 %")
    axes.plot(at, estimate, color="#4477aa", label="observer")
    axes.plot(at, by_cells(case, trace)[every], color="#cc6677", label="eq. 1, proximal tensions")
    axes.plot(at, np.where(at > LOADED, case.force, 0.0), color="black", linewidth=1, label="load")
    axes.set(xlabel="time [s]", ylabel="force at the tip [N]", xlim=(1.0, SECONDS), ylim=(-1.5, 4.0))
    axes.legend(ncols=4, frameon=False, loc="upper right")
    figure.savefig(path, metadata={"Date": None})


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
        one = judge(cases[place], traces[place], begin, SECONDS)
        print(
            f"  {ROWS[name].words:52s}{work:24s}{one.error:8.3f}{one.worst:8.3f}{one.deviation:8.3f}"
            f"{100 * one.covered:8.1f}%{one.by_cells:8.3f}"
        )
    if options.figure:
        case = next(case for case in cases_of(ROWS["two"]) if np.isclose(case.output, np.radians(67)))
        draw(options.figure, case)
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
