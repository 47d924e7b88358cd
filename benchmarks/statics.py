"""How fast the equilibrium solve is, as ratios against peers measured in the same run.

Peers: SciPy's vectorised elementwise.find_root, given its brackets for free, and a Newton iteration written in NumPy.
"""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import elementwise

import tenodesis as tn
from tenodesis.instrument import TendonGear
from tenodesis.verification import scipy_peer

Array = NDArray[np.float64]

POINTS = 1_000_000
ROUNDS = 7
TARGETS = {"SciPy elementwise.find_root": 100.0, "Newton in NumPy": 10.0, "one core": 1.8}


def numpy_newton(inst: TendonGear, handle: Array, force: Array) -> Array:
    """Return the output angle by Newton's iteration on the balance, stepping all points until the last has settled."""
    big, small, k = inst.proximal_gear_radius, inst.distal_gear_radius, inst.tendon_stiffness
    pull = 2 * big * np.sin(handle / 2)
    lever = force * (inst.end_effector_length / small)
    x = pull / (2 * small)
    with np.errstate(invalid="ignore"):
        for _ in range(12):
            stretch = k * (pull - 2 * small * x)
            agonist, antagonist = inst.pretension + stretch, inst.pretension - stretch
            taut = (agonist > 0).astype(float) + (antagonist > 0)
            cosine = np.sqrt(1 - x * x)
            residual = np.maximum(agonist, 0) - np.maximum(antagonist, 0) - force - lever / cosine
            step = residual / (-2 * k * small * taut - lever * x / cosine**3)
            x = x - step
            # Points past the fold never settle: they leave as NaN or wander, and must not hold up the rest.
            if np.nanquantile(np.abs(step[::97]), 0.97) < 1e-12:
                break
        return 2 * np.arcsin(x)


def seconds(call: Callable[[], object], rounds: int = ROUNDS) -> list[float]:
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return times


def show(peer: str, theirs: list[float], ours: list[float]) -> None:
    """Print the peer's time over ours, means against each other and our worst round against the peer's best."""
    mean, worst = np.mean(theirs) / np.mean(ours), min(theirs) / max(ours)
    target = TARGETS[peer]
    verdict = "reached" if mean >= target else "MISSED"
    print(f"  over {peer:<28} mean {mean:7.1f}x   worst {worst:7.1f}x   target {target:g}x {verdict}")


def main() -> None:
    inst = tn.load("real-size")
    assert isinstance(inst, TendonGear)
    random = np.random.default_rng(2)
    reach = float(tn.statics.handle_angle(inst, inst.output_range))
    handle = random.uniform(-reach, reach, POINTS)
    force = random.uniform(-1.3, 1.3, POINTS) * float(tn.statics.slack_force(inst, 0.0))

    state = tn.statics.equilibrium(inst, handle, force)
    slack = np.mean((state.agonist == 0) | (state.antagonist == 0))
    lost = np.mean(np.isnan(state.output_angle))
    print(
        f"{POINTS} equilibrium solves, mixed: {100 * slack:.1f} % with a slack tendon, {100 * lost:.1f} % past the fold"
    )

    def solve() -> object:
        return tn.statics.output_angle(inst, handle, force)

    cores = tn.threads.threads()
    tn.set_threads(1)
    solve()
    one = seconds(solve)
    print(
        f"one core: {1e9 * np.mean(one) / POINTS:.1f} ns a solve (mean), {1e9 * max(one) / POINTS:.1f} ns (worst round)"
    )

    peak, unloaded, solvable = scipy_peer.brackets(inst, handle, force)
    # SciPy gets only points that have a root, and where to look for it.
    subset = np.flatnonzero(solvable)
    low, high, angle, load = peak[subset], unloaded[subset], handle[subset], force[subset]
    theirs: list[Array] = []

    def find_root() -> None:
        found = elementwise.find_root(
            lambda theta, h, f: scipy_peer.residual(theta, inst, h, f), (low, high), args=(angle, load)
        )
        theirs[:] = [2 * found.x]

    ours = tn.statics.output_angle(inst, angle, load)
    subset_times = seconds(lambda: tn.statics.output_angle(inst, angle, load))
    show("SciPy elementwise.find_root", seconds(find_root, 3), subset_times)
    difference = np.nanmax(np.abs(theirs[0] - ours))
    print(f"    same points; largest difference {difference:.1e} rad")

    newton = numpy_newton(inst, handle, force)
    show("Newton in NumPy", seconds(lambda: numpy_newton(inst, handle, force)), one)
    solved = np.isfinite(state.output_angle)
    close = np.abs(newton - state.output_angle)[solved] < 1e-9
    print(f"    same points; it finds {100 * close.mean():.2f} % of the equilibria to 1e-9 rad")

    if cores < 2:
        print("  two cores: only one here, not measured")
        return
    # Four million points, so that starting a thread does not show; in turns, so that both meet the same noise.
    handle, force = np.tile(handle, 4), np.tile(force, 4)
    ones, twos = [], []
    for _ in range(ROUNDS):
        tn.set_threads(1)
        ones += seconds(solve, 1)
        tn.set_threads(2)
        twos += seconds(solve, 1)
    tn.set_threads(cores)
    print("two cores:")
    show("one core", ones, twos)


if __name__ == "__main__":
    main()
