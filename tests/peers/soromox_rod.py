"""A backbone between two tendons as segments of constant strain in SoRoMoX: run as a program where it is installed.

Prints JSON: place across and along (m) and angle (rad) of the end at rest under tensions and a force across in the
stem's axes, equilibria a second, and steps a second of its forward dynamics, alone and of many worlds together.
"""

import argparse
import json
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from soromox.actuation.threadlike import ThreadlikeActuator, ThreadlikeRouting
from soromox.systems.components import LinkSpec
from soromox.systems.pcs.pcs import PCS
from soromox.systems.pcs.structures import PCSStructure

_ROUNDS = 5
_NEWTON = 12
_STEPS = 20


def robot(given: argparse.Namespace) -> PCS:
    """Return the backbone along x, its tendons at either side along y, without shear, twist and stretch."""
    radius, parts = 1e-3, given.segments
    young = given.rigidity / (np.pi * radius**4 / 4)
    link = LinkSpec.circular(
        length=given.length / parts, radius=radius, density=1.1e4, young_modulus=young, poisson_ratio=0.3,
        reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    )  # fmt: skip
    places = jnp.array([[0.0, given.offset, 0.0], [0.0, -given.offset, 0.0]])
    routing = ThreadlikeRouting.linear(intercept=places, start_segment_index=0, end_segment_index=parts - 1)
    bends = jnp.tile(jnp.array([False, False, True, False, False, False]), parts)
    return PCS.from_links(
        [link] * parts,
        structure=PCSStructure(strain_selector=bends),
        gravity=jnp.zeros(3),
        actuators=ThreadlikeActuator.tendons(routing),
        backend="jax",
    )


def timed(run: Callable[[], Any]) -> float:
    """Return the seconds of the fastest of several runs, after one that compiles."""
    jax.block_until_ready(run())
    took = []
    for _ in range(_ROUNDS):
        begun = time.perf_counter()
        jax.block_until_ready(run())
        took.append(time.perf_counter() - begun)
    return min(took)


def rest(given: argparse.Namespace) -> dict[str, Any]:
    """Return where the backbone comes to rest."""
    rod = robot(given)
    tensions, end = jnp.array(given.tensions), jnp.array(given.length)

    def place(q: Any) -> Any:
        return rod.forward_kinematics(q, end)[:3, 3]

    def across(q: Any, force: Any) -> Any:
        return jax.grad(lambda own: force * place(own)[1])(q)

    def missing(q: Any, force: Any) -> Any:
        return rod.elastic_force(q) - rod.actuation_force(q, tensions) - across(q, force)

    def solved(force: Any) -> Any:
        q = jnp.zeros(given.segments)
        return jax.lax.fori_loop(
            0, _NEWTON, lambda _, now: now - jnp.linalg.solve(jax.jacfwd(missing)(now, force), missing(now, force)), q
        )

    def moved(force: Any) -> Any:
        def step(y: Any, _: None) -> tuple[Any, None]:
            pushed = across(y[: given.segments], force)
            return y + given.step * rod.forward_dynamics(0.0, y, (tensions, pushed)), None

        return jax.lax.scan(step, jnp.zeros(2 * given.segments), None, length=_STEPS)[0]

    forces = jnp.full(given.worlds, given.force)
    many, one = jax.jit(jax.vmap(solved)), jax.jit(solved)
    q = one(given.force)
    pose = np.asarray(rod.forward_kinematics(q, end))
    step_one, step_many = jax.jit(moved), jax.jit(jax.vmap(moved))
    return {
        "place": [float(pose[1, 3]), float(pose[2, 3])],
        "angle": float(q.sum() * given.length / given.segments),
        "missing": float(jnp.abs(missing(q, given.force)).max()),
        "solves": given.worlds / timed(lambda: many(forces)),
        "steps": _STEPS / timed(lambda: step_one(given.force)),
        "steps of worlds": given.worlds * _STEPS / timed(lambda: step_many(forces)),
        "version": version("soromox"),
    }


def main() -> None:
    """Print the result as JSON."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser()
    parser.add_argument("--length", type=float, default=40e-3)
    parser.add_argument("--rigidity", type=float, default=1e-3)
    parser.add_argument("--offset", type=float, default=2e-3)
    parser.add_argument("--tensions", type=float, nargs=2, default=[10.0, 0.0])
    parser.add_argument("--force", type=float, default=0.5)
    parser.add_argument("--segments", type=int, default=4)
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--step", type=float, default=1e-7)
    print(json.dumps(rest(parser.parse_args())))


if __name__ == "__main__":
    main()
