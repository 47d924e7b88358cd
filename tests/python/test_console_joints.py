"""The page of instruments given by joints and tendons: the same page, with controls by their names."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import kinematics
from tenodesis.console import Page, serve
from tenodesis.console.browser import _help
from tenodesis.console.display import shown_signals
from tenodesis.console.scene import with_short_stem
from tenodesis.control import Controller, compensated
from tenodesis.live.commands import RestartableConnection
from tenodesis.live.host import Host
from tenodesis.live.loop import Choices
from tenodesis.statics import chain
from tenodesis.twin import Twin

from .conftest import until
from .console_guest import Guest, get, operates

YAW = "Handle yaw, °"


def test_what_a_law_does_not_serve_is_unknown_and_all_else_is_shown_by_joint_and_tendon() -> None:
    inst = tn.load("hybrid-scaled-up")
    handle = np.outer(np.linspace(0, 1, 400), [0.2, -0.1, 0.1])
    run = Twin(inst).run(handle, wrench=[0.4, 0, 0, 0, 0, 0], controller=Controller(compensated(inst)))
    seen = shown_signals(inst, {"time": run.time, **run.signals()})
    assert seen.output.shape == seen.target.shape == seen.estimated.shape == (400, 3)
    assert seen.tension.shape == seen.stroke.shape == (400, 5)
    assert np.isnan(seen.estimated[:, 2]).all()
    assert np.array_equal(seen.estimated[:, :2], run.estimated_output_angle)
    assert seen.wrench[-1, 0] == 0.4
    assert np.isnan(seen.force).all()
    assert seen.target[-1] == pytest.approx(chain.output_angles(inst, run["handle_angle"][-1]), abs=1e-9)


def test_without_a_handle_the_target_is_what_the_motors_have_wound() -> None:
    inst = tn.load("needle-driver").replace(friction={"law": "none"})
    speeds = np.zeros((2000, 6))
    speeds[:500, 0], speeds[:500, 1] = 0.5, -0.5
    run = Twin(inst).run(np.zeros((2000, 0)), spool_velocity=speeds)
    seen = shown_signals(inst, {"time": run.time, **run.signals()})
    assert seen.handle.shape == (2000, 0)
    assert seen.target[-1] == pytest.approx(seen.output[-1], abs=1e-3)
    assert abs(seen.target[-1, 0]) > 0.1


def test_the_help_speaks_of_what_the_instrument_has() -> None:
    assert "law *robust*" in _help(tn.load("scaled-up"))
    assert "law *robust*" in _help(tn.load("hybrid-real-size"))
    assert "law *robust*" not in _help(tn.load("needle-driver"))
    assert "grip" not in _help(tn.load("two-segment-continuum"))


class Served:
    """The page of an instrument in the live process, and a connection that only watches."""

    def __init__(self, page: Page, watch: RestartableConnection) -> None:
        self.page, self.watch = page, watch

    @property
    def latest(self) -> dict[str, Any]:
        return self.watch.latest()


@pytest.fixture
def served(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Served]:
    host = Host(request.param, Choices(real_time=False), tmp_path)
    try:
        with (
            closing(host.connect("test")) as watch,
            serve(host.connect, port=0, recordings=tmp_path, instruments=()) as page,
        ):
            yield Served(page, watch)
    finally:
        host.close()


@pytest.mark.process
@pytest.mark.parametrize("served", ["hybrid-scaled-up"], indirect=True)
def test_a_slider_moves_a_joint_of_the_handle_and_the_view_while_others_watch(served: Served) -> None:
    with Guest(served.page) as first:
        until(lambda: operates(served.watch.status(), first) and first.property(YAW, "disabled") is False)
        with Guest(served.page) as second:
            until(lambda: second.property(YAW, "disabled"))
            first.set(YAW, 20.0)
            until(lambda: np.degrees(served.latest["commands"]["handle_angle"][0]) == pytest.approx(20, abs=0.01))
            second.set(YAW, -10.0)
            until(lambda: any("only watch" in notice for notice in second.notices))
            until(lambda: second.property(YAW, "value") == pytest.approx(20, abs=0.2))
        scene = next(iter(served.page._browsers.values())).scene

        def drawn_where_it_is() -> bool:
            row, inst = served.latest, served.watch.inst
            there = kinematics.frames(with_short_stem(inst), row["output_angle"], row["handle_angle"])
            place = scene._scale * there.bodies["jaw_tip"].position
            return bool(np.abs(scene._bodies["jaw_tip"].position - place).max() < 5e-3)

        until(drawn_where_it_is)
        first.set("Enable", True)
        until(lambda: served.watch.status().state == "ENABLED")
        first.set("Load y, N", 0.5)
        until(lambda: served.latest["wrench"][1] == pytest.approx(0.5))
        first.set("Law", "off")
        until(lambda: served.watch.status().law == "off")
        first.set("Spool grip, °", 5.0)
        until(lambda: np.degrees(served.latest["spool_angle"][4]) == pytest.approx(5, abs=0.5))
        for value in (np.nan, 1e300, "text", None, [1, 2]):
            for label in (YAW, "Load x, N", "Law", "Object between the jaws", "Opening, mm", "Spool grip, °"):
                first.set(label, value)
        assert get(served.page, "/stop", X_Tenodesis="stop").status == 200
        until(lambda: served.watch.status().state == "PAUSED")
        row = served.latest
        assert np.abs(row["commands"]["handle_angle"]).max() <= 1.6
        assert np.abs(row["wrench"]).max() <= 2.5
    until(lambda: served.watch.status().operator is None)


@pytest.mark.process
@pytest.mark.parametrize("served", ["needle-driver"], indirect=True)
def test_without_a_handle_the_sliders_are_the_joints_that_the_motors_turn(served: Served) -> None:
    with Guest(served.page) as guest:
        until(lambda: operates(served.watch.status(), guest) and guest.property("Pitch, °", "disabled") is False)
        until(lambda: guest.sees("Press *Enable*"))
        assert served.watch.status().law == "joints"
        guest.set("Enable", True)
        until(lambda: served.watch.status().state == "ENABLED")
        guest.set("Pitch, °", 15.0)
        guest.set("Jaw 1, °", 30.0)
        until(lambda: np.degrees(served.latest["output_angle"])[:2] == pytest.approx([15, 30], abs=1.5))
        guest.set("Opening, mm", 2.0)
        guest.set("Object between the jaws", True)
        until(lambda: served.latest["commands"]["held"][0] == pytest.approx(2e-3))
        guest.set("Object between the jaws", False)
        until(lambda: not served.latest["commands"]["held"].any())
        served.watch.stop()
        until(lambda: served.watch.status().state == "PAUSED")
        guest.set("Shipped", "scaled-up")
        guest.set("Run this instrument", True)
        until(lambda: served.watch.inst.name == "scaled-up")
        until(lambda: operates(served.watch.status(), guest) and guest.property(YAW, "disabled") is False)

        def loads() -> bool:
            # Until the browser operates the new instrument, its sliders are taken back.
            guest.set("Load yaw, N", 0.5)
            return bool(served.latest["force"] == pytest.approx(0.5))

        until(loads)
