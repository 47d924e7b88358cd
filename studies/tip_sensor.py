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
from tenodesis.twin.rows import COMMANDS, SIGNALS

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
    (twin,) = Twin(work.plant, seed=work.seed[1]).cores
    count = work.handle.size
    commands, signals = np.zeros((count, len(COMMANDS))), np.empty((count, len(SIGNALS)))
    commands[:, COMMANDS.index("handle_angle")], commands[:, COMMANDS.index("force")] = work.handle, work.force
    motors = [COMMANDS.index(f"{side}_spool_velocity") for side in ("agonist", "antagonist")]
    spools = [SIGNALS.index(f"spool_angle.{side}") for side in ("agonist", "antagonist")]
    tip = SIGNALS.index("output_angle")
    lost = np.zeros(max(1, round(lasting / (TICK * TIME_STEP))))
    for n in range(count // TICK):
        now, following = slice(n * TICK, (n + 1) * TICK), slice((n + 1) * TICK, (n + 2) * TICK)
        twin.run(commands[now], signals[now])
        last = signals[now][-1]
        given = (last[spools[0]] - last[spools[1]]) / (2 * per_angle)
        lost[n % lost.size] = np.radians(target[now][-1]) - last[tip] + given
        lasted = max(lost.min(), 0.0) + min(lost.max(), 0.0)
        speed = float(np.clip(own["gain"] * per_angle * (lasted - given), -fastest, fastest))
        commands[following, motors[0]], commands[following, motors[1]] = speed, -speed
    return signals[:, tip]


FOUND = [
    Column("worse", "worse", np.sum, "d"),
    Column("by RMS", "more_rms", lambda values: sum(np.array(values) > harm.MORE_RMS), "d"),
    Column("by peak", "more_peak", lambda values: sum(np.array(values) > harm.MORE_PEAK), "d"),
    Column("mean RMS", "rms"),
    Column("off", "rms_off"),
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
    print(campaign.table(rows.by("lasting"), FOUND, "given back: what has lasted, s"))


if __name__ == "__main__":
    main()
