"""Whether a sensor at the tip would spare the harm that motors do: the random work of harm.py, measured without error.

The motors give back what is lost, or of this only what has lasted for some time; the gain is the robust law's.
"""

import harm
import law
import numpy as np

from tenodesis.control import parameters
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column
from tenodesis.twin import TIME_STEP, Twin
from tenodesis.twin.rows import columns_by_name

TICK = 4  # steps
LASTING = (0.0, 0.5, 1.0, 2.0)  # s


def trial(number: int, seed: int, lasting: float) -> harm.Metrics:
    """Compare motors that give back what has been lost for a time (s) with motors that stand."""
    work = harm.make_work(law.instrument(list(law.RATED)[number % len(law.RATED)]), seed, number)
    off, target = harm.run_off(work)
    return harm.errors(run(work, target, lasting), off, target)


def run(work: harm.Work, target: harm.Array, lasting: float) -> harm.Array:
    """Return the tip's angle, rad, whose motors give back what has been lost for a time (s)."""
    own = parameters(work.plant).axes[0]
    per_angle = own["distal_radius"] / own["spool_radius"]
    fastest = own["tendon_speed"] / own["spool_radius"]
    twin = Twin(work.plant, seed=work.seed[1]).core
    count = work.handle.size
    given, found = columns_by_name(twin.commands), columns_by_name(twin.signals)
    commands, signals = (np.zeros((count, sum(width for _, width in of))) for of in (twin.commands, twin.signals))
    commands[:, given["handle_angle"].start], commands[:, given["force"].start] = work.handle, work.force
    motors, spools, tip = given["spool_velocity"], found["spool_angle"], found["output_angle"].start
    lost = np.zeros(max(1, round(lasting / (TICK * TIME_STEP))))
    for n in range(count // TICK):
        now, following = slice(n * TICK, (n + 1) * TICK), slice((n + 1) * TICK, (n + 2) * TICK)
        twin.run(commands[now], signals[now])
        last = signals[now][-1]
        wound = -np.diff(last[spools])[0] / (2 * per_angle)
        lost[n % lost.size] = np.radians(target[now][-1]) - last[tip] + wound
        lasted = max(lost.min(), 0.0) + min(lost.max(), 0.0)
        speed = float(np.clip(own["gain"] * per_angle * (lasted - wound), -fastest, fastest))
        commands[following, motors] = speed, -speed
    return signals[:, tip]


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
