"""What a browser asks for, kept until the page's next tick: of each kind the latest only, however many come."""

import threading
from collections.abc import Callable
from typing import TypeAlias

Action: TypeAlias = Callable[[], object]


class Inbox:
    """Actions by kind; a kind that is asked for again takes the place of the one before."""

    def __init__(self) -> None:
        self._actions: dict[str, Action] = {}
        self._lock = threading.Lock()

    def ask(self, kind: str, action: Action) -> None:
        """Ask for an action with the next tick."""
        with self._lock:
            self._actions.pop(kind, None)
            self._actions[kind] = action

    def take(self) -> list[Action]:
        """Return what was asked for, in the order it was asked for last, and forget it."""
        with self._lock:
            actions, self._actions = self._actions, {}
        return list(actions.values())
