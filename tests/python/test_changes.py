"""Claims about a world that changes while motors are wound: what stops, returns, and the measure of harm can be met."""

from typing import Any

import numpy as np
import pytest

from tenodesis.control import Controller, Request
from tenodesis.twin import TIME_STEP, Twin

from .conftest import load_study

changes = load_study("changes")
harm = load_study("harm")
INSTRUMENTS = ["scaled-up", "real-size"]


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("by", [*changes.STOPS, "law off"])
@pytest.mark.parametrize("side", changes.SIDES)
def test_what_stops_leaves_the_tip_as_motors_off_do_once_the_load_has_gone(name: str, by: str, side: float) -> None:
    for angle in changes.ANGLES:
        found = changes.trial("stopped", name, angle, side=side, by=by)
        assert found["more_end"] < 1
        # A stop in mid-stroke is over before the load goes: less tension holds the tip less than with motors off.
        assert found["more_peak"] < (2.5 if by == "stop in mid-stroke" else 0.2)
        # It is named, and what returns is no fault of its own.
        assert len(found["names"]) == (by in ("NaN", "cell stuck", "handle lost"))


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("at", [1.0, 1.3, 1.6])
def test_homing_that_is_refused_leaves_the_tendons_as_it_has_found_them(name: str, at: float) -> None:
    for side in changes.SIDES:
        found = changes.trial("refused", name, 0.0, side=side, at=at, share=1.0)
        assert found["failure"]
        assert found["more_end"] < 0.5


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_a_return_moves_the_tip_by_no_more_than_10_degrees_a_second_and_wound_says_how_far_it_is(name: str) -> None:
    inst = changes.law.instrument(name)
    time = changes.law.clock(12)
    force = np.where(time > 1.0, changes.RATED[name], 0.0)
    controller = Controller(inst)
    twin = Twin(inst)
    twin.run(np.zeros(8000), force[:8000], controller=controller)
    wound = controller.wound()
    off = Twin(inst).run(np.zeros(8000), force[:8000])["output_angle"][-1]
    # The motors hold what the load had taken.
    assert wound == pytest.approx(-off, rel=0.35)
    controller.ask(Request.DISABLE)
    run = twin.run(np.zeros(16000), force[8000:], controller=controller)
    assert abs(controller.wound()) < np.radians(0.2)
    assert np.degrees(np.abs(run["output_angle"][-1] - off)) < 0.5
    spools = run["spool_angle"] * inst.drives.spool_radius
    assert np.abs(np.diff(spools, axis=0)).max() / TIME_STEP <= np.radians(10.1) * inst.joints[-1].radius
    assert np.ptp(spools[-2000:], axis=0).max() < 1e-7


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_a_file_that_says_hold_holds(name: str) -> None:
    inst = changes.law.instrument(name).replace(**{"control.stop": "hold"})
    force = np.where(changes.law.clock(4) > 1.0, changes.RATED[name], 0.0)
    request = np.zeros(8000, int)
    request[6000] = Request.DISABLE
    run = Twin(inst).run(np.zeros(8000), force, controller=Controller(inst), request=request)
    assert np.ptp(run["spool_angle"][6200:], axis=0).max() < 1e-3


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("side", changes.SIDES)
def test_a_rope_that_gets_longer_is_named_soon_or_takes_a_loaded_tip_no_farther_than_with_motors_off(
    name: str, side: float
) -> None:
    for angle in changes.ANGLES:
        found = changes.trial("rope", name, angle, side=side, longer=0.4, pretension=1.0)
        assert found["more_unnamed"] < 1
        assert set(found["names"]) <= {"rope_length"}


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("pretension", [0.8, 1.2])
def test_a_pretension_that_is_not_the_files_is_seen_by_the_tensions_at_the_start(name: str, pretension: float) -> None:
    for side in changes.SIDES:
        found = changes.trial("rope", name, 33.0, side=side, longer=0.0, pretension=pretension)
        assert found["rms"] < 0.15
        assert found["rms_off"] > 1
        assert not found["names"]


def test_a_law_that_is_changed_is_the_one_that_works_and_an_unknown_one_is_refused(scaled: Any) -> None:
    controller = Controller(scaled, observer="exact", law="exact")
    with pytest.raises(ValueError, match="law"):
        controller.choose("robust")
    controller.choose("off")
    assert (controller.law, controller.actuation) == ("off", "differential")


def test_a_sensor_at_the_tip_does_no_harm_by_the_measure_and_some_by_that_of_motors_off() -> None:
    """So the measure can be met; that of motors off cannot."""
    inst = harm.law.instrument("real-size")
    time = harm.law.clock(harm.SECONDS)
    force = harm.RATED["real-size"] * 0.8 * np.sign(np.sin(2 * np.pi * (time - harm.LOADED))) * (time > harm.LOADED)
    handle = harm.law.held(inst, 67.0, time, harm.EASED)
    work = harm.Work((1, 1), inst, inst, handle, force, "still", "steps", "")
    off, target = harm.run_off(work)
    tip = harm.law.tip_sensor(inst, 1, handle, force, np.radians(target))
    assert harm.errors(tip, off, target)["worse"]


@pytest.mark.parametrize("number", range(10))
def test_work_that_changes_is_drawn_again_as_it_was(number: int) -> None:
    inst = harm.law.instrument(INSTRUMENTS[number % 2])
    one, other = (harm.changed(harm.make_work(inst, 3, number)) for _ in range(2))
    assert one.load in harm.CHANGES
    assert np.array_equal(one.force, other.force)
    assert one.words == other.words
