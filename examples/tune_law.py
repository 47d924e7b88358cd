"""Tune the robust law over a family of plants that its model does not describe, and judge it on plants held out.

    python examples/tune_law.py --out tuned.json

The search is SciPy's differential evolution, which needs no further library. All runs of a candidate step side by side.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
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
from tenodesis.simulate import campaign
from tenodesis.twin import TIME_STEP, run_many

Array = NDArray[np.float64]
Choice = tuple[LawName, Mapping[str, float]]
SEARCHED = ("dead_band", "gain", "tendon_speed", "common_stroke", "friction_uncertainty", "stiffness_uncertainty")
"""Keys of the instrument's table [control], each searched from half to twice what the law is shipped with."""
SPAN, SPREAD = np.log(2), 0.3
BEFORE, AFTER, EVERY = 1.5, 5.0, 20  # s, s, steps
ASSUMED = (0.7, 1.0, 1.3)  # friction that the controller assumes, over the truth


class Case(NamedTuple):
    """A plant, what its controller knows of it, and its work: a step load on a still hand, or hand and load move."""

    plant: Instrument
    known: Instrument
    handle: Array
    force: Array
    still: bool


class Score(NamedTuple):
    """Errors of the tip, deg, and harm done: by how much a run's RMS exceeds that of motors off, mean over the runs."""

    final: float
    """RMS over still hands, in the last second."""
    worst: float
    moving: float
    """RMS over moving hands, from the load on."""
    harm: float

    @property
    def objective(self) -> float:
        """What is minimised."""
        return self.final + 0.1 * self.worst + 0.1 * self.moving + self.harm


def cases(inst: Instrument, held_out: bool) -> list[Case]:
    """Return the training cases, or those held out: of other plants, in other states, under other loads."""
    family = {one.key: one for one in differences(inst) if not one.homes}
    names = ("two_vertices", "base") if held_out else ("none", "compliance", "softer", "rougher")
    plants = [(inst.replace(**family[key].known, **family[key].unknown), family[key].known) for key in names]
    plants += [(one, {}) for one in gym.randomised(inst, 15 if held_out else 2, seed=30 if held_out else 10)]
    states, loads, sway, reversal = [0, -33, 67, -80], [1.0], 0.6, 0.5  # deg, of the rated load, Hz, Hz
    if held_out:
        plants.append((inst.replace(mismatch=inst.mismatch.model_dump() | {"load_cell_gain": (1.01, 0.99)}), {}))
        states, loads, sway, reversal = [15, 50, 75], [-0.9, 0.6], 0.35, 1.0
    time = np.arange(1, round((BEFORE + AFTER) / TIME_STEP) + 1) * TIME_STEP
    turns = np.radians(3) * np.sin(2 * np.pi * sway * time) * np.clip(time / BEFORE, 0, 1)
    wave = np.cos(2 * np.pi * reversal * (time - BEFORE))
    found = []
    for (plant, known), state, load, factor in product(plants, states, loads, ASSUMED):
        assumed = controller_model(inst.replace(**known), factor)
        motion = held_motion(inst, np.radians(state), load * step_force(inst), BEFORE, AFTER)
        found.append(Case(plant, assumed, motion.handle_angle, motion.force, still=True))
        if abs(state) < 70:  # beyond, the handle has no room to sway
            found.append(Case(plant, assumed, motion.handle_angle + turns, motion.force * wave, still=False))
    return found


def errors(given: Sequence[Case], choice: Choice) -> Array:
    """Return the tip's distance, deg, from where the handle puts it without load and friction: (case, time)."""
    law, control = choice
    found = np.empty((len(given), round((BEFORE + AFTER) / TIME_STEP) // EVERY))
    contacts = [case.plant.friction.vertices_per_joint for case in given]
    for number in set(contacts):  # plants that can step together
        places = [n for n, own in enumerate(contacts) if own == number]
        own = [given[n] for n in places]
        handle, force = (np.array([getattr(one, name) for one in own]) for name in ("handle", "force"))
        controllers = [Controller(one.known.replace(**control), law=law) for one in own]
        signals = ("output_angle", "handle_angle")
        plants = [one.plant for one in own]
        batch = run_many(plants, handle, force, controllers=controllers, signals=signals, every=EVERY)
        found[places] = batch["output_angle"] - tn.statics.output_angle(own[0].known, batch["handle_angle"])
    return np.degrees(found)


def score(given: Sequence[Case], found: Array, off: Array) -> Score:
    """Return the figures of runs, by their errors and those of motors off."""
    still = np.array([case.still for case in given])
    last, loaded = round(1 / TIME_STEP) // EVERY, round(BEFORE / TIME_STEP) // EVERY
    final = found[still, -last:].mean(1)
    rms, rms_off = (campaign.rms(one[:, loaded:], axis=1) for one in (found, off))
    values = [campaign.rms(final), np.abs(final).max(), campaign.rms(rms[~still])]
    values.append(np.maximum(rms - rms_off, 0).mean())
    return Score(*np.nan_to_num(values, nan=99.0))  # of a tip without equilibrium


class Campaign:
    """Runs of laws over cases, on this machine or on a cluster."""

    def __init__(self, given: Sequence[Case], cluster: Cluster | None) -> None:
        self.given, self.cluster, self.runs = given, cluster, 0
        self.off = self._errors([("off", {})])[0]

    def scores(self, choices: Sequence[Choice]) -> list[Score]:
        """Return the figures of laws and of changes to the table [control] of their controllers."""
        return [score(self.given, found, self.off) for found in self._errors(choices)]

    def _errors(self, choices: Sequence[Choice]) -> list[Array]:
        self.runs += len(choices) * len(self.given)
        given, candidates = self.given, [{"law": law, "control": control} for law, control in choices]

        def trial(law: LawName, control: Mapping[str, float]) -> dict[str, Array]:
            return {"errors": errors(given, (law, control))}

        rows = campaign.run(trial, candidates, on=self.cluster or "threads", size=len(given))
        return [row["errors"] for row in rows]


def tune(campaign: Campaign, shipped: Sequence[float], options: argparse.Namespace) -> dict[str, float]:
    """Return the best parameters found, by key; the shipped ones are the first candidate."""

    def controls(logarithms: Array) -> dict[str, float]:
        values = shipped * np.exp(logarithms)
        return {f"control.{key}": float(value) for key, value in zip(SEARCHED, values, strict=True)}

    def objective(columns: Array) -> Array:
        return np.array([one.objective for one in campaign.scores([("robust", controls(x)) for x in columns.T])])

    def report(intermediate_result: OptimizeResult) -> None:
        print(f"generation {intermediate_result.nit:3}: objective {intermediate_result.fun:.4f}", flush=True)

    random = np.random.default_rng(options.seed)
    first = np.clip(random.normal(0, SPREAD, (options.population, len(SEARCHED))), -SPAN, SPAN)
    first[0] = 0
    box = np.full((len(SEARCHED), 2), (-SPAN, SPAN))
    how = {"vectorized": True, "updating": "deferred", "polish": False, "tol": 0, "callback": report}
    found = differential_evolution(objective, box, maxiter=options.generations, init=first, rng=random, **how)
    return controls(found.x)


def main(arguments: Sequence[str] | None = None) -> dict[str, dict[str, Score]]:
    """Tune, print the tables, and return the figures by cases and law."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--generations", type=int, default=20)
    parser.add_argument("--population", type=int, default=16, help="candidates of a generation, 5 or more")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ray", metavar="ADDRESS", help="cluster to run on: host:port, auto, or local to start one")
    parser.add_argument("--out", type=Path, help="JSON file for the tuned parameters")
    options = parser.parse_args(arguments)
    inst, begun = tn.load("scaled-up"), time.perf_counter()
    axis = tn.control.parameters(controller_model(inst)).axes[0]
    shipped = [getattr(inst.control, key) or axis[key] for key in SEARCHED]
    with Cluster(options.ray) if options.ray else nullcontext() as cluster:
        campaigns = {name: Campaign(cases(inst, name != "training"), cluster) for name in ("training", "held out")}
        tuned = tune(campaigns["training"], shipped, options)
        laws: dict[str, Choice] = {"motors off": ("off", {}), "eq. 22": ("paper", {})}
        laws |= {"robust law as shipped": ("robust", {}), "robust law tuned": ("robust", tuned)}
        found = {name: dict(zip(laws, one.scores([*laws.values()]), strict=True)) for name, one in campaigns.items()}
    print(f"\n{'[control]':24}{'shipped':>12}{'tuned':>12}")
    for key, before, after in zip(SEARCHED, shipped, tuned.values(), strict=True):
        print(f"{key:24}{before:12.4g}{after:12.4g}")
    for name, rows in found.items():
        heading = f"{name}, {len(campaigns[name].given)} runs [deg]"
        print(f"\n{heading:30}{'final RMS':>10}{'worst':>8}{'moving RMS':>12}{'harm':>8}{'objective':>11}")
        for law, one in rows.items():
            print(f"{law:30}{one.final:10.3f}{one.worst:8.2f}{one.moving:12.2f}{one.harm:8.3f}{one.objective:11.3f}")
    took, steps = time.perf_counter() - begun, (BEFORE + AFTER) / TIME_STEP / 1e6
    runs = sum(one.runs for one in campaigns.values())
    print(f"\n{runs} runs, {runs * steps:.0f} M steps of the twin in {took:.0f} s: {runs * steps / took:.2f} M steps/s")
    if cluster is not None:
        print(f"{'node':16}{'runs':>8}{'M steps/s':>11}{'M steps/s a core':>18}")
        for node, share in cluster.shares.items():
            done = share.size * steps
            print(f"{node:16}{share.size:8}{done / took:11.2f}{done / share.seconds:18.2f}")
    if options.out:
        options.out.write_text(json.dumps(tuned, indent=2) + "\n", "utf-8")
    return found


if __name__ == "__main__":
    main()
