"""A backbone as a Cosserat rod in PyElastica, brought to rest: run as a program where PyElastica is installed.

Prints JSON: place (m), angle (rad) and axis of the end under moments about y and a force and a moment about z at the
end, all in the stem's axes, and the moment of tendons that keep their places in the sections; how long it takes, and
steps a second.
"""

import argparse
import json
import time
from importlib.metadata import version
from typing import Any

import elastica as ea
import numpy as np


class _Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
    pass


class _Moment(ea.NoForces):
    """A moment about an axis of the stem, shared by elements, raised in time."""

    def __init__(self, moment: float, ramp: float, elements: tuple[int, ...], axis: int = 1) -> None:
        self.moment = moment / len(elements) * np.eye(3)[axis]
        self.ramp, self.elements = ramp, elements

    def apply_torques(self, system: Any, time: Any = 0.0) -> None:
        share = min(1.0, float(time) / self.ramp)
        for at in self.elements:
            about = system.director_collection[:, :, at] @ (share * self.moment)
            system.external_torques[:, at] += about


class _Tendons(ea.NoForces):
    """The moment of tendons about the sections' axes, (3,), the same in all of them: a bend that the rod rests in."""

    def __init__(self, moment: Any, ramp: float) -> None:
        self.moment, self.ramp = np.array([*moment, 0.0]), ramp

    def apply_torques(self, system: Any, time: Any = 0.0) -> None:
        bend = self.moment / np.array([system.bend_matrix[i, i, 0] for i in range(3)])
        system.rest_kappa[:] = min(1.0, float(time) / self.ramp) * bend[:, np.newaxis]


def rest(given: argparse.Namespace) -> dict[str, Any]:
    """Return where the rod comes to rest."""
    simulator = _Simulator()
    radius, density = 1e-3, 1.1e4
    area, second = np.pi * radius**2, np.pi * radius**4 / 4
    young = given.rigidity / second
    shear = young / 2.6 if given.torsion is None else given.torsion / (2 * second)
    rod = ea.CosseratRod.straight_rod(
        given.elements, np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), given.length, radius,
        density, youngs_modulus=young, shear_modulus=shear,
    )  # fmt: skip
    simulator.append(rod)
    simulator.constrain(rod).using(ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    ramp = 0.2 * given.seconds
    force = np.array(given.force)
    simulator.add_forcing_to(rod).using(ea.EndpointForces, np.zeros(3), force, ramp_up_time=ramp)
    simulator.add_forcing_to(rod).using(_Moment, given.moment, ramp, (given.elements - 1,))
    simulator.add_forcing_to(rod).using(_Moment, given.twist, ramp, (given.elements - 1,), 2)
    if any(given.tendons):
        simulator.add_forcing_to(rod).using(_Tendons, given.tendons, ramp)
    middle = given.elements // 2
    simulator.add_forcing_to(rod).using(_Moment, given.middle, ramp, (middle - 1, middle))
    step = 0.3 * given.length / given.elements / np.sqrt(young / density)
    first = 3.516 / given.length**2 * np.sqrt(given.rigidity / (density * area))
    simulator.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=2 * first, time_step=step)
    simulator.finalize()
    stepper, steps = ea.PositionVerlet(), int(given.seconds / step)
    begun = time.perf_counter()
    now = 0.0
    for at in range(steps):
        if at == 10:  # compiled by then
            begun = time.perf_counter()
        now = stepper.step(simulator, now, step)
    took = time.perf_counter() - begun
    x, y, z = rod.position_collection[:, -1]
    along = rod.director_collection[2, :, -1]
    return {
        "place": [float(x), float(y), float(z)],
        "angle": float(np.arctan2(along[0], along[2])),
        "axis": along.tolist(),
        "speed": float(np.abs(rod.velocity_collection).max()),
        "seconds": took,
        "steps": (steps - 10) / took,
        "version": version("pyelastica"),
    }


def main() -> None:
    """Print the result as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--length", type=float, default=40e-3)
    parser.add_argument("--rigidity", type=float, default=1e-3)
    parser.add_argument("--moment", type=float, default=0.02)
    parser.add_argument("--middle", type=float, default=0.0, help="moment at half of the length")
    parser.add_argument("--force", type=float, nargs=3, default=[0.5, 0.0, 0.0])
    parser.add_argument("--twist", type=float, default=0.0, help="moment about z at the end")
    parser.add_argument("--torsion", type=float, help="G J, N m^2")
    parser.add_argument("--tendons", type=float, nargs=2, default=[0.0, 0.0], help="about the sections' x and y, N m")
    parser.add_argument("--elements", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=0.2)
    print(json.dumps(rest(parser.parse_args())))


if __name__ == "__main__":
    main()
