"""Whether a sensor at the tip would spare the harm that motors do: the random work of harm.py, measured without error.

The motors give back what is lost, or of this only what has lasted for some time; the gain is the robust law's.
"""

import harm
import law
import numpy as np

from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column

LASTING = (0.0, 0.5, 1.0, 2.0)  # s


def trial(number: int, seed: int, lasting: float) -> harm.Metrics:
    """Compare motors that give back what has been lost for a time (s) with motors that stand."""
    work = harm.make_work(law.instrument(list(law.RATED)[number % len(law.RATED)]), seed, number)
    off, target = harm.run_off(work)
    tip = law.tip_sensor(work.plant, work.seed[1], work.handle, work.force, np.radians(target), lasting)
    return harm.errors(tip, off, target)


FOUND = [
    Column("worse, ", "worse", np.sum, "d"),
    Column("by RMS, ", "more_rms", lambda values: sum(np.array(values) > harm.MORE_RMS), "d"),
    Column("by peak, ", "more_peak", lambda values: sum(np.array(values) > harm.MORE_PEAK), "d"),
    Column("mean RMS", "rms"),
    Column("motors off", "rms_off"),
]


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.runs < 1:
        parser.error("--runs must be at least 1")
    cases = campaign.cases(number=range(options.runs), seed=[options.seed], lasting=LASTING)
    rows = campaign.run(trial, cases, "tip sensor", results=options.results)
    print(f"{options.runs} runs, tip measured without error, error in deg")
    law.show(options, "tip_sensor", rows.by("lasting"), FOUND, "given back: what has lasted, s")


if __name__ == "__main__":
    main()
