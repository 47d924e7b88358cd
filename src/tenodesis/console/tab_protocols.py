"""The tab of the experiments: a button per protocol."""

from functools import partial
from typing import Any

from tenodesis import simulate
from tenodesis.console.session import PageState, Session, as_plain, enable, set_properties
from tenodesis.errors import ProtocolError
from tenodesis.files import as_text
from tenodesis.live.status import ProtocolStatus
from tenodesis.simulate import Protocol

_NONE = "No experiment runs."


class ProtocolsTab:
    """A button for every shipped protocol and for a file, and the progress of the protocol that runs."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._simulated = session.link.capabilities.simulated
        gui: Any = session.client.gui
        self._state = gui.add_markdown(_NONE)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("Cancel it", color="gray", visible=False)
        if not self._simulated:
            gui.add_markdown("*Experiments move the handle, load the tip and place tissue: on the twin only.*")
        self._buttons: list[Any] = []
        for name in simulate.shipped():
            protocol = simulate.load(name)
            button = gui.add_button(name, hint=protocol.description, icon="player-play")
            gui.add_markdown(f"*{protocol.description}.*")
            session.on(button, "play", partial(self._begin, partial(self._play, protocol)))
            self._buttons.append(button)
        self._upload = gui.add_upload_button("Protocol file from here", mime_type=".toml", icon="upload")
        session.on(self._upload, "upload protocol", partial(self._begin, self._play_file))
        session.on(self._cancel, "cancel", session.link.cancel)

    def update(self, state: PageState) -> None:
        """Show the progress of the protocol."""
        protocol, runs = state.status.protocol, state.status.protocol_runs
        enable((*self._buttons, self._upload), state.operating and self._simulated and not runs)
        enable((self._cancel,), state.operating)
        set_properties(self._bar, visible=runs)
        set_properties(self._cancel, visible=runs)
        set_properties(self._state, content=_progress(protocol, runs))
        if protocol is not None and protocol.total > 0:
            set_properties(self._bar, value=min(100.0, round(100 * protocol.done / protocol.total, 1)))

    def _begin(self, play: Any) -> None:
        # Planning a long protocol takes seconds.
        self._session.run_in_background("play", play)

    def _play(self, protocol: Protocol) -> None:
        protocol.plan(self._session.link.inst, 1e-3)
        self._session.link.play(protocol)

    def _play_file(self) -> None:
        file = self._upload.value
        text = as_text(file.content, file.name, ProtocolError, "a TOML file")
        self._play(simulate.parse(text, file.name))


def _progress(protocol: ProtocolStatus | None, runs: bool) -> str:
    """Return the progress of a protocol as Markdown."""
    if protocol is None:
        return _NONE
    name, done, total, problem = as_plain(protocol.name), protocol.done, protocol.total, protocol.problem
    if runs:
        return f"**{name}** runs: {done:.1f} s of {total:.1f} s" if problem is None else as_plain(problem)
    if problem is not None:
        return f"**{name}** ended after {done:.1f} s of {total:.1f} s: {as_plain(problem.rstrip('.'))}."
    return f"**{name}** is done; its recording is under *Files*."
