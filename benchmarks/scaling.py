"""How fast scale models are judged: a million combinations over the full frictionless model, at 64 points each.

The peer is the same judgement by the package's own vectorised statics, one scale model after the other, as one would
write it in Python.
"""

import time
from pathlib import Path

import numpy as np

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
    fronts = {}
    seconds: dict[int, list[float]] = {}
    for threads in (1, cores):
        tn.set_threads(threads)
        for _ in range(ROUNDS):
            start = time.perf_counter()
            fronts[threads] = scaling.design(real_size, parts)
            seconds.setdefault(threads, []).append(time.perf_counter() - start)
    front = fronts[cores]
    same = np.array_equal(fronts[1].sweep.numbers, front.sweep.numbers) and np.array_equal(
        fronts[1].sweep.costs, front.sweep.costs
    )
    points = front.sweep.range.coarse.force.size
    print(f"{front.examined} scale models of {real_size.name}, {points} points each; {len(front)} on the front")
    for threads, times in seconds.items():
        mean, worst = np.mean(times), max(times)
        print(f"  on {threads} cores, catalogue to front   mean {mean:5.2f} s   worst {worst:5.2f} s", end="")
        print(f"   target {SECONDS_TARGET:g} s {'reached' if worst <= SECONDS_TARGET else 'MISSED'}")
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
    ratios = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for length in np.linspace(0.05, 0.25, PEERS):
            judged_in_python(
                real_size, scaled.replace(end_effector_length=length), span.handle_angle, span.force, expected
            )
        peer = (time.perf_counter() - start) / PEERS
        start = time.perf_counter()
        front = scaling.design(real_size, parts)
        ratios.append(peer / ((time.perf_counter() - start) / front.examined))
    tn.set_threads(cores)
    mean, worst = np.mean(ratios), min(ratios)
    verdict = "reached" if worst >= RATIO_TARGET else "MISSED"
    print(f"  over one after the other in Python   mean {mean:6.0f}x   worst {worst:6.0f}x", end="")
    print(f"   target {RATIO_TARGET:g}x {verdict}")


if __name__ == "__main__":
    main()
