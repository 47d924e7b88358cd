"""Dither in the place of the first strokes: the tip is on target soon, and both spools turn alike."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, JointController
from tenodesis.errors import ArgumentError
from tenodesis.run import Run
from tenodesis.twin import Twin

from .motions import clock, eased, load_of, with_friction

LOADED, SECONDS, DITHERS = 1.8, 3.0, 6  # s, s, of the signal phase


def loaded(observe: str, assumed: float, friction: float = 1.0) -> Run:
    """A load that comes at once to an instrument whose controller assumes another friction."""
    inst = tn.load("scaled-up")
    plant, known = (with_friction(inst, factor) for factor in (friction, assumed * friction))
    controller = Controller(known.replace(**{"control.observe": observe}))
    force = np.where(clock(SECONDS) > LOADED, load_of(plant, 0.4), 0.0)
    return Twin(plant, seed=1).run(eased(np.radians(25), 1.2, SECONDS), force, controller=controller)


def missed(run: Run) -> np.ndarray:
    inst = with_friction(tn.load("scaled-up"))
    return np.degrees(run["output_angle"] - tn.statics.unloaded_angle(inst, run["handle_angle"]))


@pytest.mark.parametrize("assumed", [0.7, 1.0, 1.3])
def test_dither_brings_the_tip_to_its_target_whatever_friction_is_assumed(assumed: float) -> None:
    run = loaded("dither", assumed)
    error = missed(run)
    after = run.time > LOADED
    assert np.abs(error[after]).max() > 4
    assert np.abs(error[run.time > LOADED + 0.4]).max() < 0.7
    assert not run.fault_times


def test_dither_turns_both_spools_to_and_fro_alike_and_ends() -> None:
    run = loaded("dither", 1.0)
    dithers = run["phase"] == DITHERS
    assert 0.1 < dithers[run.time > LOADED].sum() / dithers.size * SECONDS < 0.55
    # The tip is on target by then.
    late = dithers & (run.time > LOADED + 0.25)
    agonist, antagonist = run["spool_velocity"][late].T
    assert late.sum() > 20
    assert np.ptp(agonist + antagonist) > 10 * np.ptp(agonist - antagonist)


def test_automatic_dither_leaves_strong_friction_to_strokes() -> None:
    assert (loaded("auto", 1.0)["phase"] == DITHERS).any()
    assert (loaded("auto", 1.0, friction=3.0)["phase"] == DITHERS).mean() * SECONDS < 0.01
    assert not (loaded("strokes", 1.0)["phase"] == DITHERS).any()


def test_the_law_of_all_joints_has_strokes_alone() -> None:
    with pytest.raises(ArgumentError) as error:
        JointController(tn.load("needle-driver").replace(**{"control.observe": "dither"}))
    assert (error.value.key, error.value.value) == ("observe", "dither")
