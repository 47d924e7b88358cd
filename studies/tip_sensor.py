"""Whether a sensor at the tip would spare the harm that motors do: the random work of harm.py, measured without error.

The motors give back what is lost, or of this only what has lasted for some time; the gain is the robust law's.
"""

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import harm
import numpy as np

import tenodesis as tn
from tenodesis.control import parameters
from tenodesis.twin import TIME_STEP, Twin
from tenodesis.twin.rows import COMMANDS, SIGNALS

TICK = 4  # steps
LASTING = (0.0, 0.5, 1.0, 2.0)  # s


def compare(number: int, seed: int) -> list[harm.Comparison]:
    """Compare motors that give back what has been lost for each of :data:`LASTING` with motors that stand."""
    (inst,) = harm.instruments([list(harm.RATED)[number % len(harm.RATED)]])
    work = harm.make_work(inst, seed, number)
    off, target = harm.run_off(work)
    return [
        harm.Comparison(work, *harm.errors(run(work, target, lasting), off, target), 0.0, 0.0, 0.0, ())
        for lasting in LASTING
    ]


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.runs < 1:
        parser.error("--runs must be at least 1")
    tn.set_threads(1)
    begun = time.perf_counter()
    print(f"{options.runs} runs, tip measured without error, error in deg")
    print("  given back: what has lasted    worse   by RMS  by peak   mean RMS     off")
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = pool.map(partial(compare, seed=options.seed), range(options.runs), chunksize=10)
        columns = list(zip(*found, strict=True))
    for lasting, done in zip(LASTING, columns, strict=True):
        worse = sum(one.worse for one in done)
        rms = sum(one.more_rms > harm.MORE_RMS for one in done)
        peak = sum(one.more_peak > harm.MORE_PEAK for one in done)
        mean, mean_off = np.mean([(one.rms, one.rms_off) for one in done], axis=0)
        print(f"{lasting:23.1f} s{worse:13d}{rms:9d}{peak:9d}{mean:11.2f}{mean_off:8.2f}")
    print(f"{time.perf_counter() - begun:.0f} s on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
