"""How often the truth lies in the 95 % intervals of fit_at_rest: two backbones, noise on places and angles."""

import argparse
from pathlib import Path

import numpy as np

import tenodesis as tn
from tenodesis.identification import AtRest, fit_at_rest
from tenodesis.identification.any_instrument import at_rest

EXAMPLES = Path(__file__).parents[1] / "examples"
UNKNOWNS = {
    "backbone": ("bend.backbone_rigidity", "agonist.bend.radius", "antagonist.bend.radius"),
    "three_tendons": ("bend.backbone_rigidity", "bend.torsional_rigidity", "a.bend.radius", "b.bend.angle"),
}
READINGS, PLACE, ANGLE = 20, 2e-4, 5e-3
"""Of each fit, and the noise of a coordinate, m, and of an angle, rad."""


def main() -> None:
    """Print by unknown in how many fits its interval has the truth."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=50)
    seeds = parser.parse_args().seeds
    for file, unknowns in UNKNOWNS.items():
        inst = tn.instrument.expanded(tn.load(EXAMPLES / f"{file}.toml"))
        rng = np.random.default_rng(0)
        wrench = np.zeros((READINGS, 6))
        wrench[:, 0] = rng.uniform(-0.5, 0.5, READINGS)
        if len(inst.tendons) > 2:
            wrench[:, 1] = rng.uniform(-0.5, 0.5, READINGS)
            wrench[:, 5] = rng.uniform(-0.01, 0.01, READINGS)
        data = AtRest(strokes=rng.uniform(-1e-3, 2e-3, (READINGS, len(inst.tendons))), wrench=wrench)
        exact = at_rest(inst, data)
        # Without noise the search ends where it starts, at the truth.
        truth = {name: one.value for name, one in fit_at_rest(inst, data._replace(**exact), unknowns).unknowns.items()}
        inside = dict.fromkeys(unknowns, 0)
        for seed in range(seeds):
            noise = np.random.default_rng(seed)
            noisy = data._replace(
                position=exact["position"] + PLACE * noise.standard_normal(exact["position"].shape),
                angles=exact["angles"] + ANGLE * noise.standard_normal(exact["angles"].shape),
            )
            for name, one in fit_at_rest(inst, noisy, unknowns).unknowns.items():
                inside[name] += one.low < truth[name] < one.high
        print(f"{file}: " + ", ".join(f"{name} {count} of {seeds}" for name, count in inside.items()), flush=True)


if __name__ == "__main__":
    main()
