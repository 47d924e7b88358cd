"""Tune the robust law over a family of plants that its model does not describe, and judge it on plants held out.

    python examples/tune_law.py --generations 25 --out tuned.json

The search is SciPy's differential evolution, which needs no further library. All runs of a candidate step side by side.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, differential_evolution

import tenodesis as tn
from tenodesis import gym
from tenodesis.cluster import Cluster
from tenodesis.control import Controller, LawName
from tenodesis.instrument import Instrument
from tenodesis.paper.step_response import controller_model, held_motion, step_force
from tenodesis.paper.unlike_model import differences
from tenodesis.twin import TIME_STEP, run_many

Array = NDArray[np.float64]
SEARCHED = ("dead_band", "gain", "tendon_speed", "common_stroke", "friction_uncertainty", "stiffness_uncertainty")
"""Keys of the instrument's table [control], each searched from half to twice what the law is shipped with."""
SPAN, SPREAD = np.log(2), 0.3
BEFORE, AFTER, EVERY = 1.5, 5.0, 20  # s, s, steps
TOLD = (0.7, 1.0, 1.3)  # friction that the controller is told, over the truth


class Case(NamedTuple):
    """A plant, what its controller is told of it, and its work: a step load on a still hand, or hand and load move."""

    plant: Instrument
    told: Instrument
    handle: Array
    force: Array
    still: bool


class Score(NamedTuple):
    """Errors of the tip, deg: of the last second of still hands (RMS, worst), RMS of moving ones; harm done."""

    final: float
    worst: float
    moving: float
    harm: float
    """By how much a run's RMS from the load on exceeds that of motors off, mean over the runs, deg"""

    @property
    def objective(self) -> float:
        return self.final + 0.1 * self.worst + 0.1 * self.moving + self.harm


def cases(inst: Instrument, held_out: bool) -> list[Case]:
    """Return the training cases, or those held out: of other plants, in other states, under other loads."""
    family = {one.key: one for one in differences(inst) if not one.homes}
    names = ("two_vertices", "base") if held_out else ("none", "compliance", "softer", "rougher")
    plants = [(inst.replace(**family[key].known, **family[key].unknown), family[key].known) for key in names]
    if held_out:
        plants.append((inst.replace(mismatch=inst.mismatch.model_dump() | {"load_cell_gain": (1.01, 0.99)}), {}))
        plants += [(one, {}) for one in gym.randomised(inst, 5, seed=20)]
    states, loads, rates = ((15, 50, 75), (-0.9, 0.6), (0.35, 1.0)) if held_out else ((0, 33, 67, 80), (1,), (0.6, 0.5))
    time = np.arange(1, round((BEFORE + AFTER) / TIME_STEP) + 1) * TIME_STEP
    found = []
    for (plant, known), state, load, factor in product(plants, states, loads, TOLD):
        told = controller_model(inst.replace(**known), factor)
        force = load * step_force(inst)
        motion = held_motion(inst, np.radians(state), force, BEFORE, AFTER)
        found.append(Case(plant, told, motion.handle_angle, motion.force, still=True))
        if state < 70:  # beyond, the handle has no room to sway
            sway = np.radians(3) * np.sin(2 * np.pi * rates[0] * time) * np.clip(time / BEFORE, 0, 1)
            wave = np.cos(2 * np.pi * rates[1] * (time - BEFORE))
            found.append(Case(plant, told, motion.handle_angle + sway, motion.force * wave, still=False))
    return found


def errors(given: Sequence[Case], choice: tuple[LawName, Mapping[str, float]]) -> Array:
    """Return the tip's distance, deg, from where the handle puts it without load and friction: (case, time)."""
    law, control = choice
    found = np.empty((len(given), round((BEFORE + AFTER) / TIME_STEP) // EVERY))
    contacts = np.array([case.plant.friction.vertices_per_joint for case in given])
    for number in np.unique(contacts):  # plants that can step together
        places = np.flatnonzero(contacts == number)
        own = [given[n] for n in places]
        controllers = [Controller(one.told.replace(**control), "friction", law) for one in own]
        batch = run_many(
            [one.plant for one in own],
            np.array([one.handle for one in own]),
            np.array([one.force for one in own]),
            controllers=controllers,
            signals=("output_angle", "handle_angle"),
            every=EVERY,
        )
        found[places] = batch["output_angle"] - tn.statics.output_angle(own[0].told, batch["handle_angle"])
    return np.degrees(found)


def score(given: Sequence[Case], found: Array, off: Array) -> Score:
    still = np.array([case.still for case in given])
    last, loaded = round(1 / TIME_STEP) // EVERY, round(BEFORE / TIME_STEP) // EVERY
    final = found[still, -last:].mean(1)
    rms, rms_off = (np.sqrt(np.mean(one[:, loaded:] ** 2, axis=1)) for one in (found, off))
    moving = np.sqrt(np.mean(rms[~still] ** 2))
    judged = Score(np.sqrt(np.mean(final**2)), np.abs(final).max(), moving, np.maximum(rms - rms_off, 0).mean())
    return judged if np.isfinite(judged.objective) else Score(*[99.0] * 4)  # a tip without equilibrium


class Campaign:
    """Cases, and where their runs are made: on this machine, or on a cluster."""

    def __init__(self, given: Sequence[Case], cluster: Cluster | None) -> None:
        self.given, self.cluster, self.candidates = given, cluster, 0
        self.off = self._run([("off", {})])[0]

    def _run(self, choices: Sequence[tuple[LawName, Mapping[str, float]]]) -> list[Array]:
        self.candidates += len(choices)
        if self.cluster is not None:
            return self.cluster.map(errors, self.given, choices)
        return [errors(self.given, choice) for choice in choices]

    def scores(self, choices: Sequence[tuple[LawName, Mapping[str, float]]]) -> list[Score]:
        return [score(self.given, found, self.off) for found in self._run(choices)]


def tune(campaign: Campaign, shipped: Mapping[str, float], options: argparse.Namespace) -> dict[str, float]:
    """Return the best parameters found, by key of [control]; the shipped ones are the first candidate."""

    def controls(logarithms: Array) -> dict[str, float]:
        factors = np.exp(logarithms)
        return {f"control.{key}": float(shipped[key] * factor) for key, factor in zip(SEARCHED, factors, strict=True)}

    def objective(columns: Array) -> Array:
        return np.array([one.objective for one in campaign.scores([("robust", controls(x)) for x in columns.T])])

    def report(intermediate_result: OptimizeResult) -> None:
        print(f"generation {intermediate_result.nit:3}: objective {intermediate_result.fun:.4f}", flush=True)

    random = np.random.default_rng(options.seed)
    begin = np.clip(random.normal(0, SPREAD, (options.population, len(SEARCHED))), -SPAN, SPAN)
    begin[0] = 0
    found = differential_evolution(
        objective,
        [(-SPAN, SPAN)] * len(SEARCHED),
        maxiter=options.generations,
        init=begin,
        tol=0,
        rng=random,
        callback=report,
        polish=False,
        updating="deferred",
        vectorized=True,
    )
    return controls(found.x)


def main(arguments: Sequence[str] | None = None) -> dict[str, dict[str, Score]]:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--generations", type=int, default=25)
    parser.add_argument("--population", type=int, default=16, help="candidates of a generation, 5 or more")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ray", metavar="ADDRESS", help="cluster to run on: host:port, auto, or local to start one")
    parser.add_argument("--out", type=Path, help="JSON file for the tuned parameters")
    options = parser.parse_args(arguments)
    inst, begun = tn.load("scaled-up"), time.perf_counter()
    axis = tn.control.parameters(controller_model(inst)).axes[0]
    shipped = {key: getattr(inst.control, key) or axis[key] for key in SEARCHED}
    with ExitStack() as stack:
        cluster = stack.enter_context(Cluster(options.ray)) if options.ray else None
        training, held_out = (Campaign(cases(inst, kept), cluster) for kept in (False, True))
        tuned = tune(training, shipped, options)
        laws: dict[str, tuple[LawName, dict[str, float]]] = {"motors off": ("off", {}), "eq. 22": ("paper", {})}
        laws |= {"robust law as shipped": ("robust", {}), "robust law tuned": ("robust", tuned)}
        found = {
            name: dict(zip(laws, campaign.scores([*laws.values()]), strict=True))
            for name, campaign in (("training", training), ("held out", held_out))
        }
    print(f"\n{'[control]':24}{'shipped':>12}{'tuned':>12}")
    for key in SEARCHED:
        print(f"{key:24}{shipped[key]:12.4g}{tuned[f'control.{key}']:12.4g}")
    for name, campaign in (("training", training), ("held out", held_out)):
        heading = f"{name}, {len(campaign.given)} runs [deg]"
        print(f"\n{heading:30}{'final RMS':>10}{'worst':>8}{'moving RMS':>12}{'harm':>8}{'objective':>11}")
        for law, one in found[name].items():
            print(f"{law:30}{one.final:10.3f}{one.worst:8.2f}{one.moving:12.2f}{one.harm:8.3f}{one.objective:11.3f}")
    steps = round((BEFORE + AFTER) / TIME_STEP) * sum(len(one.given) * one.candidates for one in (training, held_out))
    took = time.perf_counter() - begun
    print(f"\n{steps / 1e6:.0f} M steps of the twin in {took:.0f} s, {steps / took / 1e6:.2f} M steps/s")
    if cluster is not None:
        print(f"{'node':20}{'runs':>8}{'M steps/s':>12}{'a core':>9}")
        for node, share in cluster.shares.items():
            done = share.chunks * steps / candidates
            print(f"{node:20}")
    if options.out:
        options.out.write_text(json.dumps(tuned, indent=2) + "\n", "utf-8")
    return found


if __name__ == "__main__":
    main()
