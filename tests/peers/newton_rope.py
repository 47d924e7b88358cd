"""Two masses on a rope over a pulley that is held, in Newton: run as a program where Newton is installed.

Prints JSON: by coefficient the acceleration that the masses have from rest, and steps a second by number of worlds.
"""

import argparse
import json
import time
from typing import Any

import newton
import numpy as np
import warp as wp

SOLVERS: dict[str, Any] = {
    "XPBD": lambda model: newton.solvers.SolverXPBD(model, iterations=32, joint_linear_relaxation=0.55),
    "VBD": lambda model: newton.solvers.SolverVBD(
        model, iterations=20, tendon_max_sweeps=32, tendon_settle_tol=1e-3, rigid_compliant_alm=False,
        rigid_avbd_beta=1e6, rigid_joint_linear_k_start=1e7, rigid_joint_angular_k_start=1e5,
        rigid_joint_linear_kd=5e-2, rigid_joint_angular_kd=2e-2,
    ),
}  # fmt: skip
"""With the settings that Newton's own examples and tests of tendons have."""
RADIUS, SIDE, HEIGHT = 0.15, 0.15, 2.0  # m: the rope's ends hang straight below the pulley's rim
MOST = 1.0  # m


def rope(coefficient: float, masses: tuple[float, float]) -> newton.ModelBuilder:
    """Return a rope over a pulley that is held, a mass at either end that moves up and down."""
    builder = newton.ModelBuilder(up_axis=newton.Axis.Z, gravity=(0.0, 0.0, -9.81))
    axis = (0.0, 1.0, 0.0)
    pulley = builder.add_body(xform=wp.transform(p=wp.vec3(0.0, 0.0, 3.5)), mass=0.0, is_kinematic=True)
    ends = []
    for side, mass in zip((-SIDE, SIDE), masses, strict=True):
        at = wp.vec3(side, 0.0, HEIGHT)
        inertia = wp.mat33(*(1e-2 * np.eye(3)).ravel().tolist())
        body = builder.add_link(xform=wp.transform(p=at), mass=mass, inertia=inertia, lock_inertia=True)
        along = newton.ModelBuilder.JointDofConfig(axis=newton.Axis.Z, limit_lower=-MOST, limit_upper=MOST)
        joint = builder.add_joint_d6(
            parent=-1, child=body, linear_axes=[along], angular_axes=[], parent_xform=wp.transform(p=at)
        )
        builder.add_articulation([joint])
        ends.append(body)
    guide, kinds = newton.TendonGuide, newton.TendonGuideType
    stiff = {"compliance": 1e-5, "damping": 5.0, "rest_length": -1.0}
    wound = {"guide_type": kinds.ROLLER, "radius": RADIUS, "orientation": 1, "mu": coefficient}
    builder.add_tendon(
        [
            guide(body=ends[0], guide_type=kinds.ANCHOR, axis=axis),
            guide(body=pulley, axis=axis, **wound, **stiff),
            guide(body=ends[1], guide_type=kinds.ANCHOR, axis=axis, **stiff),
        ]
    )  # fmt: skip
    return builder


def run(solver: str, coefficient: float, masses: tuple[float, float], step: float, seconds: float, worlds: int) -> Any:
    """Return times and ways of the light mass, m, and steps a second of all worlds together."""
    one = rope(coefficient, masses)
    builder = one
    if worlds > 1:
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z, gravity=(0.0, 0.0, -9.81))
        builder.replicate(one, worlds)
    if solver == "VBD":
        builder.color()
    model = builder.finalize()
    made = SOLVERS[solver](model)
    now, after, control = model.state(), model.state(), model.control()
    pipeline = newton.CollisionPipeline(model)
    contacts = pipeline.contacts()
    count, ways = round(seconds / step), []
    begun = time.perf_counter()
    for at in range(count):
        if at == 1:
            begun = time.perf_counter()
        now.clear_forces()
        made.step(now, after, control, contacts, step)
        now, after = after, now
        ways.append(float(now.body_q.numpy()[1, 2]) - HEIGHT)
    return step * np.arange(1, count + 1), np.array(ways), worlds * (count - 1) / (time.perf_counter() - begun)


def main() -> None:
    """Print the results as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--coefficients", type=float, nargs="+", default=[0.0, 0.2])
    parser.add_argument("--masses", type=float, nargs=2, default=[1.0, 3.0])
    parser.add_argument("--step", type=float, default=1 / 1920)
    parser.add_argument("--worlds", type=int, default=4096)
    given = parser.parse_args()
    wp.config.quiet = True
    wp.set_device("cpu")
    found: dict[str, Any] = {"version": newton.__version__}
    for solver in SOLVERS:
        rows: dict[str, Any] = {"acceleration": {}}
        for coefficient in given.coefficients:
            times, ways, rate = run(solver, coefficient, tuple(given.masses), given.step, 0.5, 1)
            half = times >= 0.1
            # a uniform acceleration after the rope has become taut
            rows["acceleration"][str(coefficient)] = 2 * float(np.polyfit(times[half], ways[half], 2)[0])
            rows["steps"] = rate
        rows["steps of worlds"] = run(solver, 0.2, tuple(given.masses), given.step, 8 * given.step, given.worlds)[2]
        rows["worlds"] = given.worlds
        found[solver] = rows
    print(json.dumps(found))


if __name__ == "__main__":
    main()
