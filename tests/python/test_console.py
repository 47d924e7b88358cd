"""The page in a browser, as a person uses it; any error on its console and any request elsewhere fails the test."""

import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.console import Page, link_page, serve, server
from tenodesis.console.access import page_html
from tenodesis.console.status import ADVICE
from tenodesis.live import folder as folders

from .conftest import until
from .console_stand_in import SHORT_PROTOCOL, StandIn

pytest.importorskip("viser", reason="the page needs viser")
playwright = pytest.importorskip("playwright.sync_api", reason="browser tests need playwright")

CHROMIUM = shutil.which("chromium") or ""
pytestmark = [pytest.mark.process, pytest.mark.skipif(not CHROMIUM, reason="browser tests need Chromium")]

PATIENCE = 60.0  # s

BAD_FILE = 'name = "x"\njoint_type = "tendon-gear"\npretension = "30 mm"\nhandle_rnge = "45 deg"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def bench(folder: Path) -> Iterator[StandIn]:
    found = StandIn(tn.load("scaled-up"), folder)
    yield found
    found.close()


def patient_html() -> str:
    """Return the page that waits longer for an answer."""
    limit = "AbortSignal.timeout(2000)"
    html = page_html()
    assert html.count(limit) == 1
    return html.replace(limit, f"AbortSignal.timeout({1000 * PATIENCE:.0f})")


@pytest.fixture(scope="module")
def served(bench: StandIn, folder: Path) -> Iterator[Page]:
    # Browsers without a graphics card draw every frame by hand, and both share the processor with the loop. What waits
    # for it keeps its connection and control, and gets the answer to its stop.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tenodesis.console.page.FRAME_RATE", 8.0)
        patch.setattr("tenodesis.console.page._HANGS_AFTER", PATIENCE)
        patch.setattr("tenodesis.console.page.page_html", patient_html)
        patch.setattr("tenodesis.console.access.LARGEST_UPLOAD", 20_000)
        patch.setitem(server._LIMITS, "ping_timeout", PATIENCE)
        with serve(bench.connect, port=0, recordings=folder) as page:
            yield page


class Window:
    """A browser's window; what goes wrong in it is kept."""

    def __init__(self, browser: Any, url: str, width: int, height: int) -> None:
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.set_default_timeout(1000 * PATIENCE)
        self.problems: list[str] = []
        self.page.on("console", self._said)
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        own = url.partition("?")[0]
        self.page.on("request", lambda request: self._requested(request.url, own))
        self.page.goto(url)
        self.page.get_by_role("button", name=re.compile("^(Enable|Resume|Take control)")).first.wait_for()
        for notice in self.page.locator(".mantine-Notification-closeButton").all():
            notice.click()

    def _said(self, message: Any) -> None:
        if message.type == "error":
            self.problems.append(f"{message.text} ({message.location['url']})")

    def _requested(self, asked: str, own: str) -> None:
        if not asked.startswith((own, "blob:" + own, "data:", own.replace("http", "ws"))):
            self.problems.append(f"asked for {asked}")

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name).first.click()

    def field(self, label: str) -> Any:
        return self.page.locator(f"xpath=(//label[.='{label}']/following::input[not(@type='hidden')])[1]")

    def choose(self, label: str, option: str) -> None:
        self.field(label).click()
        self.page.get_by_role("option", name=option, exact=True).click()

    def upload(self, button: str, name: str, content: str) -> None:
        with self.page.expect_file_chooser() as chosen:
            self.press(button)
        chosen.value.set_files({"name": name, "mimeType": "text/plain", "buffer": content.encode()})

    def sees(self, text: str, seconds: float = PATIENCE) -> None:
        self.page.get_by_text(text).first.wait_for(timeout=1000 * seconds)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as running:
        started = running.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def opened(browser: Any, served: Page) -> Iterator[Window]:
    window = Window(browser, served.url, 1100, 760)
    yield window
    window.page.close()


@pytest.fixture
def window(opened: Window) -> Iterator[Window]:
    yield opened
    assert opened.problems == []


def loss(bench: StandIn) -> float:
    """Return by how much the tip is off where the handle asks it to be, degrees."""
    now = bench.connect("test").latest()
    asked = tn.statics.output_angle(bench.inst, float(now["handle_angle"]))
    return float(np.degrees(asked - now["output_angle"]))


def test_the_link_in_a_file_opens_the_page_by_itself(browser: Any, served: Page, tmp_path: Path) -> None:
    opener = folders.write_link(tmp_path, served.url, link_page(served.url))
    page = browser.new_context().new_page()
    page.goto(opener.as_uri())
    page.get_by_role("button", name="STOP").wait_for(timeout=60_000)
    assert page.url == served.url.partition("?")[0]
    page.close()


def test_a_slider_moves_the_handle_and_the_tip_follows(window: Window, bench: StandIn) -> None:
    window.tab("Move")
    window.field("Handle yaw, °").fill("20")
    until(lambda: np.degrees(bench.connect("test").latest()["handle_angle"]) == pytest.approx(20, abs=0.01))
    origins = {origin for origin, asked in bench.commands if asked == "hand"}
    assert [re.fullmatch(r"browser \d+ at 127\.0\.0\.1:\d+", origin) is not None for origin in origins] == [True]
    window.sees("You operate")


def test_a_load_takes_angle_and_the_law_gives_it_back(window: Window, bench: StandIn) -> None:
    window.tab("Law")
    window.choose("Law", "off")
    until(lambda: bench.controller.law == "off")
    window.press("Enable")
    until(lambda: bench.connect("test").status().state == "ENABLED")
    window.tab("Move")
    window.press("Apply the load as a step")
    until(lambda: loss(bench) > 5)
    window.tab("Law")
    window.choose("Law", "robust")
    # The law's guarantee for a single run; when it is chosen depends on the machine.
    until(lambda: abs(loss(bench)) < 1)
    window.tab("Move")
    window.press("Remove the load as a step")
    until(lambda: bench.forces[0] == 0)


def test_a_fault_is_named_with_what_to_do_and_can_be_cleared(window: Window, bench: StandIn) -> None:
    window.tab("Law")
    window.page.get_by_text("Try a fault").click()
    window.choose("Fault", "The handle's encoder jumps")
    window.press("Inject it into the twin")
    window.sees("encoder_jump")
    window.sees(ADVICE["encoder_jump"].remedy)
    assert bench.connect("test").status().state == "FAULT"
    until(lambda: bench.faults[0].stop < bench.twin.time)
    window.press("Clear the fault")
    until(lambda: bench.connect("test").status().state != "FAULT")


def test_stop_stops_and_is_told(window: Window, bench: StandIn) -> None:
    window.press("STOP")
    window.sees("Stopped.")
    assert any(asked == "stop" and origin.startswith("stop button") for origin, asked in bench.commands)


def test_the_escape_key_stops_from_a_field_too_and_closes_a_list(window: Window, bench: StandIn) -> None:
    def stops() -> int:
        return sum(asked == "stop" for _, asked in bench.commands)

    before = stops()
    window.tab("Move")
    window.field("Handle yaw, °").press("Escape")
    until(lambda: stops() == before + 1)
    window.tab("Law")
    window.field("Law").click()
    # A list that is not open yet, or not closed yet, would take the key otherwise.
    option = window.page.get_by_role("option", name="off", exact=True)
    option.wait_for()
    window.page.keyboard.press("Escape")
    option.wait_for(state="hidden")
    window.field("Law").press("Escape")
    until(lambda: stops() == before + 2)


def test_a_file_that_is_too_large_is_not_even_sent(window: Window) -> None:
    window.tab("Setup")
    window.upload("Instrument file from here", "large.toml", "#" * 20_001)
    window.sees("large.toml is too large: it must have at most 0.02 MB.")


def test_a_protocol_runs_and_its_recording_is_opened_replayed_and_compared(
    window: Window, bench: StandIn, folder: Path
) -> None:
    window.tab("Tests")
    for _ in range(2):
        before = bench.recorded
        # So slowly that it still runs when the browser shows it.
        bench.rate = 0.02
        window.upload("Protocol file from here", "short.toml", SHORT_PROTOCOL)
        until(lambda before=before: bench.recorded > before)
        window.sees("short runs")
        bench.rate = 1.0
        window.sees("short is done")
    window.tab("Files")
    until(lambda: window.field("Recording").input_value() != "none yet")
    window.press("Open")
    window.sees(f"{bench.inst.name}, yaw")
    window.press("Replay in the view")
    window.sees("Back to the live instrument")
    window.press("Back to the live instrument")
    window.press("Compare the tip angles")
    # Not with itself: the newest beside the one before it.
    assert window.field("Recording").input_value() != window.field("Compare with").input_value()
    verdict = window.page.get_by_text(re.compile("they differ by")).first
    verdict.wait_for()
    found = re.search(r"differ by ([\d.]+)° RMS", verdict.inner_text())
    assert found is not None
    runs = [tn.Recording.open(path).run for path in sorted(folder.glob("*.mcap"))[-2:]]
    rows = min(map(len, runs))
    first, second = (np.degrees(run["output_angle"][:rows]).ravel() for run in runs)
    assert float(found[1]) == pytest.approx(np.sqrt(np.mean((first - second) ** 2)), abs=0.02)


def test_the_experiments_of_the_package_have_a_button_each(window: Window, bench: StandIn) -> None:
    window.tab("Tests")
    for name in tn.simulate.shipped():
        assert window.page.get_by_role("button", name=name, exact=True).count() == 1
    window.page.get_by_role("button", name="step-load", exact=True).click()
    window.sees("step-load runs")
    window.press("Cancel it")
    window.sees("step-load ended after")
    assert any(asked == "play step-load" for _, asked in bench.commands)


def test_a_wrong_instrument_file_is_explained_key_by_key_and_a_right_one_runs(window: Window, bench: StandIn) -> None:
    window.tab("Setup")
    window.upload("Instrument file from here", "bad.toml", BAD_FILE)
    window.sees("This file cannot be run")
    window.sees("handle_rnge is not a known key")
    window.sees("pretension")
    assert bench.inst.name == "scaled-up"
    window.choose("Shipped", "real-size")
    window.press("Run this instrument")
    until(lambda: bench.inst.name == "real-size")
    window.sees("Handle pitch, °")
    bench.begin(tn.load("scaled-up"))
    window.page.get_by_text("Handle pitch, °").wait_for(state="detached")


@pytest.mark.parametrize("size", [(1400, 900), (390, 844)])
def test_stop_and_state_are_seen_at_every_size(window: Window, size: tuple[int, int]) -> None:
    page = window.page
    before = page.viewport_size
    page.set_viewport_size({"width": size[0], "height": size[1]})
    try:
        page.get_by_role("tab", name="Help").wait_for()
        stop = page.get_by_role("button", name="STOP").bounding_box()
        assert stop["x"] >= 0
        assert stop["y"] >= 0
        assert stop["x"] + stop["width"] <= size[0]
        assert stop["y"] + stop["height"] <= size[1]
        assert min(stop["width"], stop["height"]) >= 48
        # Nothing lies over it, and it lies over no part of the panel.
        middle = (stop["x"] + stop["width"] / 2, stop["y"] + stop["height"] / 2)
        assert page.evaluate("([x, y]) => document.elementFromPoint(x, y).textContent", middle) == "STOP"
        for tab in page.get_by_role("tab").all():
            box = tab.bounding_box()
            assert box is None or box["y"] > stop["y"] + stop["height"] or box["y"] + box["height"] < stop["y"]
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    finally:
        page.set_viewport_size(before)


def test_a_page_whose_server_has_gone_says_that_it_shows_what_was(window: Window, bench: StandIn) -> None:
    old, stops = window.page.get_by_text("No connection: what is shown is old."), len(bench.commands)
    old.wait_for(state="detached")
    for path in ("**/alive", "**/stop"):
        window.page.route(path, lambda route: route.abort())
    old.wait_for()
    window.press("STOP")
    window.sees("No answer: switch the motors' supply off.")
    window.page.unroute_all()
    old.wait_for(state="detached")
    window.press("STOP")
    window.sees("Stopped.")
    assert [asked for _, asked in bench.commands[stops:]] == ["stop"]
    # Those that were cut off on purpose.
    assert all("ERR_FAILED" in problem for problem in window.problems)
    window.problems.clear()


def test_the_view_is_sent_while_the_loop_runs(window: Window, bench: StandIn, served: Page) -> None:
    node = "window.__viserSceneTree.getState()"
    assert window.page.evaluate(f"Object.keys({node}).some((name) => name.endsWith('yaw_far'))")
    frames, ticks, since = served.frames, bench.ticks, time.perf_counter()
    until(lambda: bench.ticks - ticks >= 2000)
    seconds = time.perf_counter() - since
    sent = served.frames - frames
    print(f"{sent / seconds:.0f} frames/s sent, the loop at {(bench.ticks - ticks) / seconds:.0f} Hz")
    assert sent > 1
