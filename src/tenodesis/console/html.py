"""The page that browsers get: the viewer's, with the stop button in front of everything."""

from importlib import resources
from pathlib import Path

from tenodesis.console.wire import LARGEST_UPLOAD

_BODY_ENDS = "</body>"


def page() -> str:
    """Return the HTML, which needs nothing from anywhere else.

    The stop button is no part of the viewer's panel, which can be folded away, and does not need its connection.
    """
    import viser  # noqa: PLC0415 - takes half a second

    viewer = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text("utf-8")
    overlay = (resources.files("tenodesis.console") / "overlay.html").read_text("utf-8")
    overlay = overlay.replace("LARGEST_UPLOAD", str(LARGEST_UPLOAD))
    before, ends, after = viewer.rpartition(_BODY_ENDS)
    return before + overlay + ends + after
