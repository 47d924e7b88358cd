"""Make the pictures of the console for README and documentation, from the page itself in a browser without a window.

A hand bends the tip, tissue pushes it out of place with the compensation off, and the robust law brings it back.
"""

import io
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from tenodesis.console import serve
from tenodesis.live.host import Host

OUT = Path(__file__).parent / "console"
DESKTOP, PHONE = (1280, 800), (390, 844)
_WIDTH = 960
_BETWEEN = 0.3  # s
_STATES = re.compile("^(Enable|Resume|Pause|Take control)")


def main() -> None:
    """Write the sequence and the pictures of a phone and of joints that share tendons."""
    chromium = shutil.which("chromium")
    if chromium is None:
        sys.exit("There is no chromium; install it first.")
    OUT.mkdir(exist_ok=True)
    with sync_playwright() as playwright, _page() as url:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        frames = _sequence(_opened(browser, url, DESKTOP))
        frames[0].save(
            OUT / "console.webp", save_all=True, append_images=frames[1:], duration=400, loop=0, quality=62, method=6
        )
        page = _opened(browser, url, PHONE)
        page.get_by_role("button", name="Take control").click()
        time.sleep(2)
        _picture(page).save(OUT / "phone.webp", quality=80, method=6)
        with _page("hybrid-scaled-up") as joints:
            _narrow(_loaded(_opened(browser, joints, DESKTOP))).save(OUT / "joints.webp", quality=80, method=6)
        browser.close()
    for path in sorted(OUT.iterdir()):
        print(f"{path} {path.stat().st_size / 1000:.0f} kB")


@contextmanager
def _page(name: str = "scaled-up") -> Iterator[str]:
    with tempfile.TemporaryDirectory() as recordings:
        host = Host(name, recordings=Path(recordings))
        try:
            with serve(host.connect, port=0, recordings=Path(recordings)) as page:
                yield page.url
        finally:
            host.close()


def _opened(browser: Any, url: str, size: tuple[int, int]) -> Any:
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.goto(url)
    page.get_by_role("button", name=_STATES).first.wait_for(timeout=60_000)
    time.sleep(3)
    for notice in page.locator(".mantine-Notification-closeButton").all():
        notice.click()
    time.sleep(1)
    return page


def _sequence(page: Any) -> list[Image.Image]:
    frames: list[Image.Image] = []

    def do(action: Callable[[], object], pictures: int) -> None:
        action()
        for _ in range(pictures):
            time.sleep(_BETWEEN)
            frames.append(_narrow(_picture(page)))

    def law(name: str) -> None:
        page.get_by_role("combobox", name="Law").click()
        page.get_by_role("option", name=name, exact=True).click()

    def tab(name: str) -> None:
        page.get_by_role("tab", name=name, exact=True).click()

    tab("Law")
    law("off")
    page.get_by_role("button", name=re.compile("^(Enable|Resume)")).first.click()
    tab("Move")
    hand = page.locator("xpath=(//label[.='Handle yaw, °']/following::input[not(@type='hidden')])[1]")
    do(lambda: time.sleep(0.5), 1)
    do(lambda: hand.fill("25"), 7)
    do(page.get_by_role("button", name="Apply the load as a step").click, 7)
    do(lambda: tab("Law"), 1)
    do(lambda: law("robust"), 9)
    return frames


def _loaded(page: Any) -> Image.Image:
    """Return the picture of joints that share tendons, bent about both axes and pushed aside, motors off."""
    page.get_by_role("button", name="tip", exact=True).click()
    for label, value in (("Handle yaw, °", "15"), ("Handle pitch, °", "10"), ("Load x, N", "2")):
        page.locator(f"xpath=(//label[.='{label}']/following::input[not(@type='hidden')])[1]").fill(value)
        time.sleep(1)
    time.sleep(2)
    return _picture(page)


def _picture(page: Any) -> Image.Image:
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def _narrow(picture: Image.Image) -> Image.Image:
    return picture.resize((_WIDTH, picture.height * _WIDTH // picture.width), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    main()
