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
from tenodesis.twin.rows import columns_by_name

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
