"""Rigidities and tendons' places of backbones, from where their tips rest."""

from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import IdentificationError
from tenodesis.identification import AtRest, fit_at_rest
from tenodesis.identification.any_instrument import at_rest, value_of
from tenodesis.instrument import FullForm

EXAMPLES = Path(__file__).parents[2] / "examples"
PLANAR = ("bend.backbone_rigidity", "agonist.bend.radius", "antagonist.bend.radius")
SPATIAL = ("bend.backbone_rigidity", "bend.torsional_rigidity", "a.bend.radius", "b.bend.angle")


def readings(inst: FullForm, rng: np.random.Generator, count: int) -> AtRest:
    wrench = np.zeros((count, 6))
    wrench[:, 0] = rng.uniform(-0.5, 0.5, count)
    if len(inst.tendons) > 2:
        wrench[:, 1] = rng.uniform(-0.5, 0.5, count)
        wrench[:, 5] = rng.uniform(-0.01, 0.01, count)
    return AtRest(strokes=rng.uniform(-1e-3, 2e-3, (count, len(inst.tendons))), wrench=wrench)


@pytest.mark.parametrize(("file", "unknowns", "seeds"), [("backbone", PLANAR, 5), ("three_tendons", SPATIAL, 2)])
def test_truth_is_in_the_intervals(file: str, unknowns: tuple[str, ...], seeds: int) -> None:
    inst = tn.instrument.expanded(tn.load(EXAMPLES / f"{file}.toml"))
    data = readings(inst, np.random.default_rng(0), 20)
    exact = at_rest(inst, data)
    told = fit_at_rest(inst, data._replace(**exact), unknowns)
    truth = np.array([of.value for of in told.unknowns.values()])
    begun = inst.replace(**{"joints.bend.backbone_rigidity": 1.2 * value_of(inst, "bend.backbone_rigidity")})
    inside = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        noisy = data._replace(
            position=exact["position"] + 2e-4 * rng.standard_normal(exact["position"].shape),
            angles=exact["angles"] + 5e-3 * rng.standard_normal(exact["angles"].shape),
        )
        found = fit_at_rest(begun, noisy, unknowns)
        assert found.noise["angles"] == pytest.approx(5e-3, rel=0.5)
        of = np.array([(one.low, one.high) for one in found.unknowns.values()])
        inside.append((of[:, 0] < truth) & (truth < of[:, 1]))
        assert np.abs([one.value for one in found.unknowns.values()] / truth - 1).max() < 0.15
    assert np.mean(inside) > 0.85


def test_rigidity_from_the_poses_of_an_elastica_under_tensions() -> None:
    inst = tn.instrument.expanded(tn.load(EXAMPLES / "backbone.toml"))
    poses = tn.poses.load(EXAMPLES / "backbone_poses.csv", inst)
    data = AtRest(tensions=poses.tensions, wrench=poses.wrench, position=poses.position)
    rigidity = value_of(inst, "bend.backbone_rigidity")
    off = inst.replace(**{"joints.bend.backbone_rigidity": 1.3 * rigidity})
    found = fit_at_rest(off, data, ["bend.backbone_rigidity", "bend.radius"])
    assert found.unknowns["bend.backbone_rigidity"].value == pytest.approx(rigidity, rel=2e-3)
    assert found.noise["position"] < 1e-5


def test_without_forces_tensions_cannot_tell_rigidity_from_offset() -> None:
    inst = tn.instrument.expanded(tn.load(EXAMPLES / "backbone.toml"))
    data = AtRest(tensions=np.array([[5.0, 5.0], [12.0, 5.0], [5.0, 9.0], [15.0, 6.0]]))
    with pytest.raises(IdentificationError, match="cannot tell bend"):
        fit_at_rest(inst, data._replace(**at_rest(inst, data)), ["bend.backbone_rigidity", "bend.radius"])


@pytest.mark.parametrize("name", ["bend", "bend.colour", "nobody.radius", "agonist.bend.side", "bend.mechanism"])
def test_an_unknown_that_is_none(name: str) -> None:
    inst = tn.instrument.expanded(tn.load(EXAMPLES / "backbone.toml"))
    with pytest.raises(IdentificationError, match="is no unknown"):
        fit_at_rest(inst, AtRest(position=np.zeros((4, 3))), [name])
