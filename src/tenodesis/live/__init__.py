"""The live instrument: a loop in a process of its own, and the clients that watch and command it."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tenodesis.live.joined import Joined, connect

__all__ = ["Joined", "connect"]


def __dir__() -> list[str]:
    return list(__all__)


def __getattr__(name: str) -> Any:
    """Import what joins a runtime when it is first used: other systems than Linux have none."""
    if name in __all__:
        from tenodesis.live import joined  # noqa: PLC0415 - see above

        return getattr(joined, name)
    raise AttributeError(f"module 'tenodesis.live' has no attribute {name!r}")
