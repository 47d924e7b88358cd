"""The tab of the instrument: the instrument that runs, and others to run from a file."""

from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from tenodesis import instrument
from tenodesis.console.session import PageState, Session, as_plain, enable, set_properties
from tenodesis.control.resolution import sentences, warnings
from tenodesis.errors import InstrumentError, LiveError
from tenodesis.files import as_text, read_regular
from tenodesis.live.controlled import controlled

_LARGEST_FILE = 1_000_000
"""Largest instrument file that is read, bytes."""
_SPEEDS = {"1/10": 0.1, "1/4": 0.25, "real time": 1.0, "2": 2.0, "5": 5.0}


class SetupTab:
    """The instrument that runs, and ways to run another; the errors of a file are listed key by key."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui: Any = session.client.gui
        inst = session.link.inst
        joints = " and ".join(joint.name for joint in inst.tip_joints)
        gui.add_markdown(
            f"**{as_plain(inst.name)}**, {as_plain(joints)}, on *{as_plain(session.link.device)}*. "
            f"{as_plain(inst.description)}"
        )
        assumed, _ = controlled(inst)
        if assumed is not None:
            said = (*sentences(assumed), *(f"Warning: {each}" for each in warnings(assumed)))
            gui.add_markdown(as_plain(" ".join(said)))
        self._shipped = gui.add_dropdown("Shipped", instrument.shipped())
        self._load = gui.add_button("Run this instrument")
        self._path = gui.add_text("Path", "", hint="On the machine that runs the instrument.")
        self._load_path = gui.add_button("Run the file at this path")
        self._upload = gui.add_upload_button("Instrument file from here", mime_type=".toml", icon="upload")
        self._problems = gui.add_html("")
        self._speed = gui.add_dropdown(
            "Simulated speed", tuple(_SPEEDS), initial_value="real time", visible=session.link.capabilities.simulated
        )
        self._release = gui.add_button(
            "Release control", color="gray", hint="The motors pause; another browser can take control."
        )
        self._shown: list[Any] = [
            self._shipped,
            self._load,
            self._path,
            self._load_path,
            self._upload,
            self._speed,
            self._release,
        ]
        session.on(self._load, "load", partial(self._begin, lambda: self._run(self._shipped.value)))
        session.on(self._load_path, "load", partial(self._begin, self._run_path))
        session.on(self._upload, "load", partial(self._begin, self._run_upload))
        session.on(self._release, "operator", session.link.release)
        session.on(self._speed, "speed", lambda: session.link.speed(_SPEEDS[self._speed.value]))

    def update(self, state: PageState) -> None:
        """Enable the controls for the operator."""
        enable(self._shown, state.operating)
        speeds = [name for name, factor in _SPEEDS.items() if factor == state.status.speed]
        if speeds and not self._session.just_changed(self._speed):
            set_properties(self._speed, value=speeds[0])

    def _begin(self, load: Any) -> None:
        # Error messages quote the file, so that only the operator may open one.
        if not self._session.link.heartbeat():
            raise LiveError("You only watch; take control first.", key="operator", allowed="you")
        self._session.run_in_background("load", load)

    def _run(self, name: str) -> None:
        self._run_checked(lambda: instrument.load(name), name)

    def _run_path(self) -> None:
        given = self._path.value.strip()
        if given in instrument.shipped():
            self._run(given)
            return
        text = read_instrument(given, self._session.folders.instruments)
        self._run_checked(lambda: instrument.parse(text, given), text)

    def _run_upload(self) -> None:
        file = self._upload.value
        text = partial(as_text, file.content, file.name, InstrumentError, "a TOML file")
        source = file.content.decode("utf-8-sig", "replace")
        self._run_checked(lambda: instrument.parse(text(), file.name), source)

    def _run_checked(self, parse: Any, source: str) -> None:
        """Run an instrument if it is valid, and list its errors otherwise."""
        try:
            inst = parse()
            set_properties(self._problems, content="")
            self._session.notify("This takes a few seconds.", f"Starting {inst.name}", good=True)
            self._session.link.load(source)
        except InstrumentError as problem:
            set_properties(self._problems, content=_error_list(str(problem)))


def read_instrument(path: str, folders: Sequence[Path]) -> str:
    """Return the text of an instrument file within folders, links resolved: error messages quote what is read.

    Raises
    ------
    InstrumentError
        It is outside the folders, no regular file, too large, or no TOML file.
    """
    among = " or ".join(str(folder.absolute()) for folder in folders)
    allowed = f"the path of an instrument file (.toml) in {among}"
    refused = InstrumentError(key="path", value=path, allowed=allowed)
    try:
        found = Path(path).resolve()
    except (OSError, ValueError, RuntimeError):
        raise refused from None
    if found.suffix != ".toml" or not any(found.is_relative_to(folder.resolve()) for folder in folders):
        raise refused
    try:
        content = read_regular(found, _LARGEST_FILE)
    except FileNotFoundError:
        raise InstrumentError(
            f"{path}: there is no such file; it must be {allowed}.", key="path", value=path, allowed=allowed
        ) from None
    except OSError as problem:
        raise InstrumentError(f"{path} cannot be read: {problem.strerror}.", key="path", value=path) from None
    return as_text(content, path, InstrumentError, "a TOML file", key="path")


def _error_list(problems: str) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in problems.splitlines() if line.strip())
    return (
        '<div style="border-left:4px solid #b4232f;background:#fdf0ef;padding:.3em .5em;font-size:.8rem" role="alert">'
        f'<b>This file cannot be run:</b><ul style="margin:.2em 0;padding-left:1.2em">{items}</ul></div>'
    )
