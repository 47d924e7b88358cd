"""The bench's experiments at a button."""

from functools import partial
from typing import Any

from tenodesis import simulate
from tenodesis.console.session import PageState, Session, enable, as_plain, set_properties
from tenodesis.errors import ProtocolError
from tenodesis.live.status import ProtocolStatus
from tenodesis.simulate import Protocol

_NOTHING = "No experiment runs."


class TestsTab:
    """A button for every protocol that is shipped, one for a file, and how far the one that runs has come."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._simulated = session.link.capabilities.simulated
        gui: Any = session.client.gui
        self._state = gui.add_markdown(_NOTHING)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("End it", color="gray", visible=False)
        if not self._simulated:
            gui.add_markdown("*Experiments move the handle and load the tip, which only the twin lets them do.*")
        self._buttons: list[Any] = []
        for name in simulate.shipped():
            protocol = simulate.load(name)
            button = gui.add_button(name, hint=protocol.description, icon="player-play")
            gui.add_markdown(f"*{protocol.description}.*")
            session.on(button, "play", partial(self._begin, partial(self._play, protocol)))
            self._buttons.append(button)
        self._upload = gui.add_upload_button("A protocol file of your own", mime_type=".toml", icon="upload")
        session.on(self._upload, "upload protocol", partial(self._begin, self._play_file))
        session.on(self._cancel, "cancel", session.link.cancel)

    def update(self, state: PageState) -> None:
        """Show how far the protocol has come."""
        played, going = state.status.protocol, state.status.protocol_runs
        enable((*self._buttons, self._upload), state.operating and self._simulated and not going)
        enable((self._cancel,), state.operating)
        set_properties(self._bar, visible=going)
        set_properties(self._cancel, visible=going)
        set_properties(self._state, content=_told(played, going))
        if played is not None and played.total > 0:
            set_properties(self._bar, value=min(100.0, round(100 * played.done / played.total, 1)))

    def _begin(self, play: Any) -> None:
        # A long protocol is planned for seconds, which the page's ticks cannot wait.
        self._session.run_in_background("play", play)

    def _play(self, protocol: Protocol) -> None:
        protocol.plan(self._session.link.inst, 1e-3)
        self._session.link.play(protocol)

    def _play_file(self) -> None:
        file = self._upload.value
        try:
            text = file.content.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise ProtocolError(f"{file.name} is not UTF-8 text; allowed is a TOML file.") from None
        self._play(simulate.parse(text, file.name))


def _told(played: ProtocolStatus | None, going: bool) -> str:
    """Return in Markdown how a protocol fares."""
    if played is None:
        return _NOTHING
    name, done, total, problem = as_plain(played.name), played.done, played.total, played.problem
    if going:
        return f"**{name}** runs: {done:.1f} s of {total:.1f} s" if problem is None else as_plain(problem)
    if problem is not None:
        return f"**{name}** ended after {done:.1f} s of {total:.1f} s: {as_plain(problem.rstrip('.'))}."
    return f"**{name}** is done; its recording is under *Files*."
