"""The bench's experiments at a button."""

from functools import partial
from typing import Any

from tenodesis import protocols
from tenodesis.console.link import running
from tenodesis.console.session import Now, Session, enable, put
from tenodesis.errors import ProtocolError
from tenodesis.protocols import Protocol


class Experiments:
    """A button for every protocol that is shipped, one for a file, and how far the one that runs has come."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui: Any = session.client.gui
        self._state = gui.add_markdown("No experiment runs.")
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("End it", color="gray", visible=False)
        self._buttons: list[Any] = []
        for name in protocols.shipped():
            protocol = protocols.load(name)
            button = gui.add_button(name, hint=protocol.description, icon="player-play")
            gui.add_markdown(f"*{protocol.description}.*")
            session.on(button, "play", partial(self._play, protocol))
            self._buttons.append(button)
        self._upload = gui.add_upload_button("A protocol file of your own", mime_type=".toml")
        session.on(self._upload, "upload protocol", self._play_file)
        session.on(self._cancel, "cancel", session.link.cancel)

    def show(self, now: Now) -> None:
        """Show how far the protocol has come."""
        played, going = now.status.protocol, running(now.status)
        enable((*self._buttons, self._upload), now.operating and not going)
        enable((self._cancel,), now.operating)
        put(self._bar, visible=played is not None)
        put(self._cancel, visible=going)
        if played is None:
            put(self._state, content="No experiment runs.")
            return
        name, done, total, problem = played
        put(self._bar, value=min(100.0, round(100 * done / total, 1)) if total > 0 else 0.0)
        if problem is not None:
            put(self._state, content=f"{problem}" if going else f"**{name}** was {problem} after {done:.1f} s.")
        elif going:
            put(self._state, content=f"**{name}** runs: {done:.1f} s of {total:.1f} s")
        else:
            put(self._state, content=f"**{name}** is done; its recording is under *Files*.")

    def _play(self, protocol: Protocol) -> None:
        protocol.plan(self._session.link.inst, 1e-3)
        self._session.link.play(protocol)

    def _play_file(self) -> None:
        file = self._upload.value
        try:
            text = file.content.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise ProtocolError(f"{file.name} is not UTF-8 text; allowed is a TOML file.") from None
        self._play(protocols.parse(text, file.name))
