"""How fast scale models are judged: a million combinations over the full frictionless model, at 64 points each.

The peer is the same judgement by the package's own vectorised statics, one scale model after the other, as one would
write it in Python.
"""

import time
from pathlib import Path

import numpy as np
from turns import in_turns, judged, rate, seconds, times_faster

import tenodesis as tn
from tenodesis import scaling
from tenodesis.instrument import TendonGear
from tenodesis.run import Array
from tenodesis.scaling.costs import working_range

ROOT = Path(__file__).parents[1]
PEERS = 300
FLEXIBLE = 100_000
ROUNDS = 3
SECONDS_TARGET = 10.0
RATIO_TARGET = 20.0


def judged_in_python(
    real_size: TendonGear, scaled_up: TendonGear, handle: Array, force: Array, expected: Array
) -> float:
    """Return the largest similarity error of one scale model, deg."""
    comparison = tn.similarity.compare(real_size, scaled_up)
    found = tn.statics.output_angle(
        scaled_up.replace(pretension=real_size.pretension * comparison.tension_factor),
        handle,
        force * comparison.force_factor(),
    )
    stop = -scaled_up.output_stop * np.sign(force)
    return float(np.degrees(np.abs(np.where(np.isnan(found), stop, found) - expected).max()))


def main() -> None:
    real_size = tn.load("real-size").axis("yaw")
    assert isinstance(real_size, TendonGear)
    parts = scaling.load()
    cores = tn.threads.threads()
    fronts: dict[int, scaling.Front] = {}

    def designed() -> None:
        fronts[tn.threads.threads()] = scaling.design(real_size, parts)

    took = {}
    for threads in (1, cores):
        tn.set_threads(threads)
        (took[threads],) = in_turns(ROUNDS, seconds(designed))
    front = fronts[cores]
    same = all(np.array_equal(getattr(fronts[1].sweep, of), getattr(front.sweep, of)) for of in ("numbers", "costs"))
    points = front.sweep.range.coarse.force.size
    print(f"{front.examined} scale models of {real_size.name}, {points} points each; {len(front)} on the front")
    for threads, times in took.items():
        print(
            f"  on {threads} cores, catalogue to front   mean {times.mean():5.2f} s   worst {times.max():5.2f} s   "
            f"{judged(times.max(), SECONDS_TARGET, ' s', most=True)}"
        )
    print(f"  the same front on 1 and {cores} cores: {'yes' if same else 'NO'}")

    flexible = tn.load(ROOT / "examples/continuum.toml")
    start = time.perf_counter()
    other = scaling.design(flexible, parts, combinations=FLEXIBLE)
    per_million = (time.perf_counter() - start) / other.examined * 1e6
    print(f"  {flexible.joint_type} on {cores} cores: {per_million:.1f} s a million, of {other.examined}; no target")

    tn.set_threads(1)
    scaled = tn.load("scaled-up")
    assert isinstance(scaled, TendonGear)
    span = working_range(real_size, max(real_size.conditions.forces)).coarse
    expected = tn.statics.output_angle(real_size, span.handle_angle, span.force)

    def peer() -> None:
        for length in np.linspace(0.05, 0.25, PEERS):
            longer = scaled.replace(end_effector_length=length)
            judged_in_python(real_size, longer, span.handle_angle, span.force, expected)

    rates = in_turns(ROUNDS, rate(front.examined, designed), rate(PEERS, peer))
    tn.set_threads(cores)
    times_faster("one after the other in Python", *rates, RATIO_TARGET)


if __name__ == "__main__":
    main()
