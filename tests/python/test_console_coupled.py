"""The page of a coupled instrument, and the twin that moves it."""

from collections.abc import Iterator

import numpy as np
import pytest

from tenodesis import instrument, kinematics
from tenodesis.cli.live import live_console
from tenodesis.console import serve_coupled
from tenodesis.console.coupled_loop import CoupledLink, CoupledLoop
from tenodesis.console.coupled_page import CoupledPage, CoupledShown, readings, shown_rows
from tenodesis.console.plots import TensionColours
from tenodesis.console.scene import with_short_stem
from tenodesis.errors import ArgumentError, CommandError, LiveError
from tenodesis.statics import chain
from tenodesis.twin import Held

from .chain_samples import LISTED
from .console_guest import Guest, get, operates, wait

YAW = "Handle yaw, °"


def stepped(inst: instrument.InstrumentLike) -> CoupledLink:
    """Return an operator's connection to a twin that goes on only on request."""
    loop = CoupledLoop(instrument.expanded(inst))
    loop.close()
    link = loop.connect("test")
    assert link.acquire()
    return link


def go_on(link: CoupledLink, seconds: float) -> None:
    for _ in range(round(seconds / 0.01)):
        if link.loop.problem is None:
            link.loop._advance()


def angles(link: CoupledLink) -> np.ndarray:
    return np.degrees(link.latest()["run"]["output_angle"][-1])


def shown(link: CoupledLink) -> CoupledShown:
    return shown_rows(link.inst, link.latest())


@pytest.mark.parametrize("name", LISTED)
def test_joints_go_where_the_operator_asks_but_for_friction(name: str) -> None:
    link = stepped(instrument.expanded(name).replace(friction={"law": "none"}))
    asked = np.radians([12.0, -8.0, 15.0])[: len(link.loop.driven)]
    link.hand(asked)
    go_on(link, 1.5)
    target = shown(link).target[-1]
    assert angles(link) == pytest.approx(np.degrees(target), abs=0.05)
    # A backbone's stiffness takes angle even without a load.
    if not link.inst.handle_joints and name != "two-segment-continuum":
        assert target == pytest.approx(asked, abs=1e-3)


def test_the_law_gives_back_what_a_force_takes_until_it_is_off() -> None:
    link = stepped("hybrid-scaled-up")
    handle = np.radians([10.0, 5.0, 0.0])
    link.hand(handle)
    link.force([0.5, 0.8, 0.0])
    go_on(link, 1.5)
    target = np.degrees(chain.output_angles(link.inst, handle))
    assert np.abs(angles(link) - target)[:2].max() > 1
    assert link.status().state == "DISABLED"
    link.request("enable")
    go_on(link, 4.0)
    assert link.status().state == "ENABLED"
    assert angles(link)[:2] == pytest.approx(target[:2], abs=0.3)
    # Motors at rest keep what they have wound.
    link.law("off", "differential")
    link.force([0.0, 0.0, 0.0])
    go_on(link, 4.0)
    assert np.abs(angles(link) - target)[:2].max() > 1
    link.stop()
    go_on(link, 0.02)
    assert link.status().state == "PAUSED"


def test_what_the_twin_cannot_hold_stops_it_where_it_is_until_something_else_is_asked() -> None:
    link = stepped("hybrid-real-size")
    link.hand(np.radians([10.0, 0.0, 0.0]))
    go_on(link, 0.5)
    before = angles(link)
    link.force([100.0, 0.0, 0.0])
    go_on(link, 0.5)
    problem = link.status().problem
    assert problem is not None
    assert "finds no equilibrium" in problem
    assert "The twin stays as it was" in problem
    stopped = link.latest()["run"].time[-1]
    go_on(link, 0.5)
    assert link.latest()["run"].time[-1] == stopped
    link.force([0.0, 0.0, 0.0])
    go_on(link, 1.0)
    assert link.status().problem is None
    assert link.latest()["run"].time[-1] > stopped
    assert angles(link) == pytest.approx(before, abs=0.5)


def test_jaws_press_what_is_between_them_and_tendons_that_let_go_are_marked_slack() -> None:
    link = stepped("needle-driver")
    link.hand(np.radians([0.0, 30.0, -30.0]))
    go_on(link, 1.0)
    with pytest.raises(ArgumentError, match=r"held\.opening is 0\.5; it must be at most"):
        link.hold(Held(0.5, 1e3))
    link.hold(Held(4e-3, 5e3))
    link.hand(np.zeros(3))
    go_on(link, 1.0)
    grip = link.latest()["run"]["grip_force"][-1]
    assert grip > 1
    text = readings(link.inst, shown(link), TensionColours(link.inst))
    assert text.count("slack") == 2
    assert f"Grip force on the object: {grip:.2f} N" in text
    link.reset()
    assert angles(link) == pytest.approx(0, abs=1e-6)
    assert link.latest()["asked"].held is None


def test_bad_values_and_those_of_a_watcher_change_nothing() -> None:
    link = stepped("hybrid-scaled-up")
    for wrong in ([0.1], [0.1, np.nan, 0.0]):
        with pytest.raises(LiveError, match="it must be 3 finite numbers"):
            link.hand(wrong)
        with pytest.raises(LiveError, match="it must be 3 finite numbers"):
            link.force(wrong)
    with pytest.raises(LiveError, match=r"angle of handle_yaw is 0\.9; it must be within"):
        link.hand([0.9, 0.0, 0.0])
    with pytest.raises(ArgumentError, match="law"):
        link.law("best", "differential")
    with pytest.raises(LiveError, match="shows hybrid-scaled-up alone"):
        link.load("needle-driver")
    other = link.loop.connect("other")
    assert not other.acquire()
    for command in (lambda: other.hand([0.1, 0.0, 0.0]), other.reset, lambda: other.hold(None)):
        with pytest.raises(LiveError, match="other only watches"):
            command()
    assert not link.latest()["asked"].angles.any()
    assert link.status().law == "robust"


def test_stop_holds_joints_that_motors_turn_until_they_are_enabled() -> None:
    link = stepped("needle-driver")
    link.hand(np.radians([30.0, 0.0, 0.0]))
    go_on(link, 0.15)
    link.loop.connect("anyone").stop()
    go_on(link, 0.3)
    held = angles(link)
    assert 2 < held[0] < 25
    assert link.status().state == "PAUSED"
    link.hand(np.radians([30.0, 0.0, 0.0]))
    go_on(link, 0.3)
    assert angles(link) == pytest.approx(held, abs=0.05)
    link.request("resume")
    link.hand(np.radians([30.0, 0.0, 0.0]))
    go_on(link, 1.0)
    assert angles(link)[0] == pytest.approx(30, abs=0.6)
    with pytest.raises(LiveError, match="has no joint that a controller can compensate"):
        link.request("home")


def test_a_machine_that_is_late_is_told_by_how_much() -> None:
    link = stepped("needle-driver")
    link.loop._times.clear()
    assert link.status().problem is None
    link.loop._times.extend([0.0, 0.02, 0.04])
    assert link.status().problem == "This machine is late: the twin runs at 50 % of real time."


@pytest.mark.parametrize(("options", "key"), [({"device": "serial"}, "--device"), ({"foxglove": 0}, "--foxglove")])
def test_options_of_a_runtime_are_refused_for_a_twin_in_the_page(options: dict[str, object], key: str) -> None:
    with pytest.raises(CommandError, match=f"^{key} is .* it must be left out for needle-driver"):
        live_console("needle-driver", **options)  # type: ignore[arg-type]


@pytest.fixture
def page() -> Iterator[CoupledPage]:
    with serve_coupled("hybrid-scaled-up", port=0) as served:
        yield served


@pytest.mark.process
def test_a_slider_moves_the_twin_and_the_view_while_others_watch(page: CoupledPage) -> None:
    loop = page._loop
    with Guest(page) as first:
        wait(lambda: operates(loop, first) and first.property(YAW, "disabled") is False)
        with Guest(page) as second:
            wait(lambda: second.property(YAW, "disabled"))
            first.set(YAW, 20.0)
            wait(lambda: np.degrees(loop.rows[-1]["handle_angle"][-1, 0]) == pytest.approx(20))
            second.set(YAW, -10.0)
            wait(lambda: any("only watches" in notice for notice in second.notices))
            assert np.degrees(loop.asked.angles[0]) == pytest.approx(20)
            wait(lambda: second.property(YAW, "value") == pytest.approx(20))
            second.set("Take control", True)
            wait(lambda: operates(loop, second))
        scene = next(iter(page._browsers.values())).scene

        def drawn_where_it_is() -> bool:
            row = loop.rows[-1]
            there = kinematics.frames(with_short_stem(loop.inst), row["output_angle"][-1], row["handle_angle"][-1])
            place = scene._scale * there.bodies["jaw_tip"].position
            return bool(np.abs(scene._bodies["jaw_tip"].position - place).max() < 5e-3)

        wait(drawn_where_it_is)
        wait(lambda: np.degrees(loop.rows[-1]["output_angle"][-1, 0]) > 30)
        wait(lambda: first.sees("yaw</td>"))


@pytest.mark.process
def test_a_browser_that_sends_what_its_panel_would_not_moves_nothing(page: CoupledPage) -> None:
    loop = page._loop
    with Guest(page) as guest:
        wait(lambda: operates(loop, guest) and guest.property(YAW, "disabled") is False)
        for value in (np.nan, 1e300, "text", None, [1, 2]):
            for label in (YAW, "Force x, N", "Law", "Object between the jaws", "Opening, mm"):
                guest.set(label, value)
        guest.set("Force y, N", 0.5)
        wait(lambda: loop.asked.force[1] == pytest.approx(0.5))
        assert np.abs(loop.asked.angles).max() <= loop.driven[0].range
        assert np.abs(loop.asked.force).max() <= 2.5
        guest.set("Enable", True)
        wait(lambda: loop.state == "ENABLED")
        assert get(page, "/stop", X_Tenodesis="stop").status == 200
        wait(lambda: loop.state == "PAUSED")
    wait(lambda: loop.operator is None)
