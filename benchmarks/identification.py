"""Speed of identification from recordings of a twin, whose true parameters are known.

The peer is the same fit by the same optimiser with differences (two points a parameter) for derivatives.
"""

import os

# One core, whatever library multiplies matrices.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import sys
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from turns import in_turns, judged, seconds

from tenodesis.identification import fit
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.problem import scales
from tenodesis.identification.twin_model.problem import TwinProblem
from tenodesis.run import Array

sys.path.append(str(Path(__file__).parents[1] / "studies"))

from coverage import STEP, TRUTH, cycled, instruments, posed

LONG_SECONDS, ROUNDS, SECONDS_TARGET = 20.0, 3, 5.0


def searched(one: TwinProblem, *, exact: bool) -> Array:
    """Return what the optimiser finds of the same parameters, with exact derivatives or by differences."""
    parameters = one.parameters
    places = [n for n, parameter in enumerate(parameters) if parameter.name in TRUTH]
    start = np.array([parameter.start for parameter in parameters])

    def full(at: Array) -> Array:
        values = start.copy()
        values[places] = at
        return values

    found = least_squares(
        lambda at: one.residuals(full(at), 0),
        start[places],
        jac=(lambda at: one.derivatives(full(at), 0, places)) if exact else "2-point",
        bounds=([parameters[n].lower for n in places], [parameters[n].upper for n in places]),
        x_scale=scales(parameters, start)[places],
        ftol=1e-9,
        xtol=1e-9,
        gtol=1e-9,
    )
    return np.asarray(found.x)


def main() -> None:
    """Print how long one fit takes, and its search alone with exact derivatives and with differences."""
    nominal, true = instruments()
    found: dict[bool, Array] = {}

    def complete(run: InstrumentRun) -> None:
        fit(posed(run, nominal), list(TRUTH), train=[0], starts=1)

    def search(run: InstrumentRun, *, exact: bool) -> None:
        found[exact] = searched(posed(run, nominal), exact=exact)

    works = complete, partial(search, exact=True), partial(search, exact=False)
    times, apart = [], 0.0
    for seed in range(ROUNDS):
        run = cycled(true, seed, LONG_SECONDS)
        times.append(in_turns(1, *(seconds(partial(work, run)) for work in works)))
        apart = max(apart, float(np.abs(found[True] - found[False]).max()))
    took = np.hstack(times)
    ratios = took[2] / took[1]
    print(f"{LONG_SECONDS:g} s at {1 / STEP:g} Hz, {len(TRUTH)} parameters, one core, one start, {ROUNDS} recordings")
    names = ("all of it, with every statistic", "search, exact derivatives", "search, differences of two points")
    for name, spent in zip(names, took, strict=True):
        print(f"  {name:<36} mean {spent.mean():6.2f} s   worst {spent.max():6.2f} s")
    print(
        f"  {judged(took[0].max(), SECONDS_TARGET, ' s', most=True)}; exact derivatives faster {ratios.mean():.2f} "
        f"times, worst {ratios.min():.2f}; both find the same to {apart:.0e}"
    )


if __name__ == "__main__":
    main()
