"""Dither in the place of the first strokes: the tip is on target sooner, and both spools turn alike."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, JointController
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.twin import Twin

from .motions import clock, eased, load_of, with_friction

LOADED, SECONDS, DITHERS = 2.5, 3.5, 6  # s, s, of the signal phase


def loaded(inst: Instrument, observe: str, assumed: float, friction: float = 1.0) -> Run:
    """A load that comes at once, while the motors rest, to an instrument whose controller assumes other friction."""
    plant, known = (with_friction(inst, factor) for factor in (friction, assumed * friction))
    controller = Controller(known.replace(**{"control.observe": observe}))
    force = np.where(clock(SECONDS) > LOADED, load_of(plant, 0.3), 0.0)
    return Twin(plant, seed=1).run(eased(np.radians(15), 0.8, SECONDS), force, controller=controller)


def left(inst: Instrument, run: Run, after: float) -> float:
    """Largest error of the tip from a time after the load on, deg."""
    later = run.time > LOADED + after
    return float(
        np.degrees(np.abs(run["output_angle"] - tn.statics.unloaded_angle(inst, run["handle_angle"]))[later].max())
    )


@pytest.mark.parametrize("name", ["scaled-up", "real-size"])
@pytest.mark.parametrize("assumed", [0.7, 1.0, 1.3])
def test_dither_brings_the_tip_to_its_target_sooner_than_strokes(name: str, assumed: float) -> None:
    inst = tn.load(name)
    dither, strokes = (loaded(inst, observe, assumed) for observe in ("dither", "strokes"))
    assert left(with_friction(inst), dither, 0.0) > 7
    assert left(with_friction(inst), dither, 0.3) < min(1.2, 0.8 * left(with_friction(inst), strokes, 0.3))
    assert not dither.fault_times
    assert not (strokes["phase"] == DITHERS).any()


def test_dither_turns_both_spools_to_and_fro_alike_and_ends() -> None:
    run = loaded(tn.load("scaled-up"), "dither", 1.0)
    dithers = (run["phase"] == DITHERS) & (run.time > LOADED)
    assert 0.1 < dithers.sum() / run.time.size * SECONDS < 0.55
    # The tip is near its target by then.
    agonist, antagonist = run["spool_angle"][dithers & (run.time > LOADED + 0.35)].T
    assert np.ptp(agonist + antagonist) > 4 * np.ptp(agonist - antagonist)


def test_automatic_dither_leaves_strong_friction_to_strokes() -> None:
    def dithers(friction: float) -> float:
        return float((loaded(tn.load("scaled-up"), "auto", 1.0, friction)["phase"] == DITHERS).mean())

    assert dithers(0.5) > 0.05
    assert dithers(6.0) < 0.005


def test_the_law_of_all_joints_has_strokes_alone() -> None:
    with pytest.raises(ArgumentError) as error:
        JointController(tn.load("needle-driver").replace(**{"control.observe": "dither"}))
    assert (error.value.key, error.value.value) == ("observe", "dither")
