"""A protocol as the text of a file for people: in the units of drawings, to nine digits."""

from typing import Any

import tomli_w

from tenodesis.instrument.text import with_units
from tenodesis.simulate import Protocol
from tenodesis.units import in_unit

_READABLE = {"rad": "deg", "rad/s": "deg/s", "m": "mm", "m/s": "mm/s"}


def to_text(protocol: Protocol, comment: str = "") -> str:
    """Return the text of a protocol file, with a comment at its head."""
    phases = [{"kind": phase.kind} | with_units(phase, unset=False) for phase in protocol.phases]
    values = with_units(protocol, unset=False) | {"phases": [_readable(phase) for phase in phases]}
    head = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    return f"{head}\n{tomli_w.dumps(values)}" if head else tomli_w.dumps(values)


def _readable(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _readable(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_readable(one) for one in value]
    number, _, unit = value.partition(" ") if isinstance(value, str) else ("", "", "")
    try:
        size = float(number)
    except ValueError:
        return value
    shown = _READABLE.get(unit, unit)
    return f"{size * in_unit(shown, unit) + 0.0:.9g} {shown}"
