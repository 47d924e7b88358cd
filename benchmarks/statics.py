"""How fast the equilibrium solve is, as ratios against peers measured in the same run.

Peers: SciPy's vectorised elementwise.find_root, given its brackets for free, and a Newton iteration written in NumPy;
for two axes that share their load, SciPy's root, point by point.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from peers import scipy_peer
from scipy.optimize import elementwise, root
from turns import in_turns, judged, rate, times_faster

import tenodesis as tn
from tenodesis import instrument
from tenodesis.instrument import TendonGear
from tenodesis.statics import chain

Array = NDArray[np.float64]

POINTS = 1_000_000
ROUNDS = 7
CHAIN_POINTS, PEER_POINTS = 200_000, 200
CHAIN_TARGET = 150.0  # ns a solve
TARGETS = {"SciPy": 100.0, "NumPy": 10.0, "one core": 1.8}


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


def two_axis_residual(x: Sequence[float], inst: TendonGear, handle: Array, force: Array) -> tuple[float, float]:
    """Return the balance of moments on yaw and pitch at the sines of half their angles, over r cos, N."""
    r, length, k = inst.distal_gear_radius, inst.end_effector_length, inst.tendon_stiffness
    (sy, sp), (across, up, out) = x, force
    cy, cp = sqrt(max(1 - sy * sy, 1e-12)), sqrt(max(1 - sp * sp, 1e-12))
    # The force in the axes of the pitch pair's middle, then of the link; pitch carries z toward y.
    mid_up, mid_out = cp * up + sp * out, cp * out - sp * up
    pitch = length * up + r * mid_up
    link_out = cp * mid_out - sp * mid_up
    # To where the force acts from the yaw pair's far centre: the link, the pitch pair, the end-effector.
    reach = 2 * r + 2 * r * cp + length * (cp * cp - sp * sp)
    yaw = reach * across + r * (cy * across + sy * link_out)
    balance = []
    for sine, cosine, moment, drawn in ((sy, cy, yaw, handle[0]), (sp, cp, pitch, handle[1])):
        stretch = 2 * k * (inst.proximal_gear_radius * drawn - r * sine)
        pull = max(inst.pretension + stretch, 0.0) - max(inst.pretension - stretch, 0.0)
        balance.append(pull + moment / (r * cosine))
    return balance[0], balance[1]


def two_axes(inst: TendonGear, random: np.random.Generator) -> None:
    """Print how fast both axes are solved under a force in any direction, and how much faster than SciPy's root."""
    wrist = instrument.expanded(inst)
    handle = random.uniform(-0.35, 0.35, (CHAIN_POINTS, 2))
    force = random.uniform(-0.6, 0.6, (CHAIN_POINTS, 3))
    wrench = np.pad(force, ((0, 0), (0, 3)))
    drawn, few = np.sin(handle / 2), slice(PEER_POINTS)
    start = inst.proximal_gear_radius / inst.distal_gear_radius * drawn
    found = np.empty((PEER_POINTS, 2))

    def peer() -> None:
        for i in range(PEER_POINTS):
            found[i] = root(two_axis_residual, start[i], args=(inst, drawn[i], force[i]), tol=1e-12).x

    def ours() -> None:
        chain.output_angles(wrist, handle, wrench)

    own, theirs = in_turns(ROUNDS, rate(CHAIN_POINTS, ours), rate(PEER_POINTS, peer))
    angles = chain.output_angles(wrist, handle[few], wrench[few])
    print("two axes under a force in any direction, one core:")
    times_faster("SciPy root, point by point", own, theirs)
    nanoseconds = 1e9 * float(np.mean(1 / own))
    print(f"    ours: {nanoseconds:.0f} ns a solve (mean), {judged(nanoseconds, CHAIN_TARGET, ' ns', most=True)}")
    print(f"    largest difference {np.nanmax(np.abs(2 * np.arcsin(found) - angles)):.1e} rad")


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
    peak, unloaded, solvable = scipy_peer.brackets(inst, handle, force)
    # SciPy gets only points that have a root, and where to look for it.
    subset = np.flatnonzero(solvable)
    low, high, angle, load = peak[subset], unloaded[subset], handle[subset], force[subset]
    found: list[Array] = []

    def find_root() -> None:
        root = elementwise.find_root(
            lambda theta, h, f: scipy_peer.residual(theta, inst, h, f), (low, high), args=(angle, load)
        )
        found[:] = [2 * root.x]

    print("one core:")
    own, theirs = in_turns(
        5, rate(subset.size, lambda: tn.statics.output_angle(inst, angle, load)), rate(subset.size, find_root)
    )
    times_faster("SciPy elementwise.find_root", own, theirs, TARGETS["SciPy"])
    difference = np.nanmax(np.abs(found[0] - tn.statics.output_angle(inst, angle, load)))
    print(f"    given its brackets, points with a root only; largest difference {difference:.1e} rad")

    own, theirs = in_turns(ROUNDS, rate(POINTS, solve), rate(POINTS, lambda: numpy_newton(inst, handle, force)))
    times_faster("Newton in NumPy", own, theirs, TARGETS["NumPy"])
    solved = np.isfinite(state.output_angle)
    close = np.abs(numpy_newton(inst, handle, force) - state.output_angle)[solved] < 1e-9
    print(f"    all points; it finds {100 * close.mean():.2f} % of the equilibria to 1e-9 rad")
    print(f"    ours: {1e9 * np.mean(1 / own):.1f} ns a solve (mean), {1e9 / own.min():.1f} ns (worst round)")

    two_axes(inst, random)
    if cores < 2:
        print("two cores: only one here, not measured")
        return
    print("two cores:")
    # Four million points, so that starting a thread does not show.
    handle, force = np.tile(handle, 4), np.tile(force, 4)

    def on(threads: int) -> None:
        tn.set_threads(threads)
        solve()

    times_faster("one core", *in_turns(ROUNDS, rate(1, lambda: on(2)), rate(1, lambda: on(1))), TARGETS["one core"])


if __name__ == "__main__":
    main()
