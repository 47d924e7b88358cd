"""Values of which one, or none, may be given."""

from pydantic import BaseModel


def exactly_one(model: BaseModel, *keys: str) -> str:
    """Return which one of some keys is given.

    Raises
    ------
    ValueError
        None is, or several are.
    """
    given = at_most_one(model, *keys)
    if given is None:
        raise ValueError(f"none of {_listed(keys)} is given; allowed is exactly one of them")
    return given


def at_most_one(model: BaseModel, *keys: str) -> str | None:
    """Return which one of some keys is given, if one is.

    Raises
    ------
    ValueError
        Several are given.
    """
    given = [key for key in keys if getattr(model, key) is not None]
    if len(given) > 1:
        raise ValueError(f"{_listed(given)} are given; allowed is one of them")
    return given[0] if given else None


def _listed(keys: list[str] | tuple[str, ...]) -> str:
    return ", ".join(keys[:-1]) + f" and {keys[-1]}"
