"""The instrument: what runs, and others from a file."""

import stat
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from tenodesis import instrument
from tenodesis.console.session import PageState, Session, enable, as_plain, set_properties
from tenodesis.errors import InstrumentError, LiveError

_LARGEST = 1_000_000
"""Of an instrument file, bytes: nothing longer is read, such as a device that never ends."""
_SPEEDS = {"a tenth": 0.1, "a quarter": 0.25, "as the clock": 1.0, "twice": 2.0, "five times": 5.0}


class SetupTab:
    """The instrument that runs, and ways to run another; a file that is wrong is explained key by key."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui: Any = session.client.gui
        inst = session.link.inst
        gui.add_markdown(
            f"**{as_plain(inst.name)}**, {' and '.join(inst.axes)}, on *{as_plain(session.link.device)}*. "
            f"{as_plain(inst.description)}"
        )
        self._shipped = gui.add_dropdown("Shipped", instrument.shipped())
        self._load = gui.add_button("Run this one")
        self._path = gui.add_text("Path", "", hint="On the machine that runs the instrument.")
        self._load_path = gui.add_button("Run the one of this path")
        self._upload = gui.add_upload_button("Instrument file from here", mime_type=".toml", icon="upload")
        self._problems = gui.add_html("")
        self._speed = gui.add_dropdown(
            "Simulated time", tuple(_SPEEDS), initial_value="as the clock", visible=session.link.capabilities.simulated
        )
        self._give = gui.add_button(
            "Give control away", color="gray", hint="The motors pause; somebody else can take over."
        )
        self._shown: list[Any] = [
            self._shipped,
            self._load,
            self._path,
            self._load_path,
            self._upload,
            self._speed,
            self._give,
        ]
        session.on(self._load, "load", partial(self._begin, lambda: self._named(self._shipped.value)))
        session.on(self._load_path, "load", partial(self._begin, self._of_path))
        session.on(self._upload, "load", partial(self._begin, self._uploaded))
        session.on(self._give, "operator", session.link.release)
        session.on(self._speed, "speed", lambda: session.link.speed(_SPEEDS[self._speed.value]))

    def update(self, state: PageState) -> None:
        """Let the operator change it."""
        enable(self._shown, state.operating)
        speeds = [name for name, factor in _SPEEDS.items() if factor == state.status.speed]
        if speeds and not self._session.just_changed(self._speed):
            set_properties(self._speed, value=speeds[0])

    def _begin(self, load: Any) -> None:
        # What a file says of others' files is for whoever may open them.
        if not self._session.link.heartbeat():
            raise LiveError("You only watch; take control first.")
        self._session.run_in_background("load", load)

    def _named(self, name_or_path: str) -> None:
        self._checked(lambda: instrument.load(name_or_path), name_or_path)

    def _of_path(self) -> None:
        given = self._path.value.strip()
        _refuse_endless(given)
        self._named(given)

    def _uploaded(self) -> None:
        file = self._upload.value

        def parse() -> instrument.Instrument:
            try:
                return instrument.parse(file.content.decode("utf-8-sig"), file.name)
            except UnicodeDecodeError:
                raise InstrumentError(f"{file.name} is not UTF-8 text; allowed is a TOML file.") from None

        self._checked(parse, file.content.decode("utf-8-sig", "replace"))

    def _checked(self, parse: Any, source: str) -> None:
        """Run an instrument if it is valid, and else say what is wrong with it."""
        try:
            inst = parse()
        except InstrumentError as problem:
            set_properties(self._problems, content=_listed(str(problem)))
            return
        set_properties(self._problems, content="")
        self._session.notify("It takes a moment.", f"Starting {inst.name}", good=True)
        self._session.link.load(source)


def _refuse_endless(path: str) -> None:
    """Refuse what is there and is no file of an instrument's length; of all else, reading says what is wrong."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return
    if not stat.S_ISREG(found.st_mode) or found.st_size > _LARGEST:
        raise InstrumentError(f"{path} cannot be an instrument file; allowed is a file of up to {_LARGEST / 1e6:g} MB.")


def _listed(problems: str) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in problems.splitlines() if line.strip())
    return (
        '<div style="border-left:4px solid #b4232f;background:#fdf0ef;padding:.3em .5em;font-size:.8rem" role="alert">'
        f'<b>This file cannot be run:</b><ul style="margin:.2em 0;padding-left:1.2em">{items}</ul></div>'
    )
