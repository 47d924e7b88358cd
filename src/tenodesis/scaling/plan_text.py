"""How a workshop plan writes numbers, masses and symbols: in plain text, for any template."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from tenodesis.report.content import fixed, number
from tenodesis.units import in_unit

SPACE = "\u00a0"
"""Between a number and its unit, which stay on one line."""

NO_ERROR = 1e-3
"""Angle, deg, below which an error is none."""

_POWERS = str.maketrans("0123456789−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_SYMBOLS = {"Theta": "Θ", "theta": "θ", "kappa": "κ", "zeta": "ζ", "phi": "φ", "mu": "μ", "^2": "²"}


def told(value: float, unit: str, digits: int, si_unit: str = "") -> str:
    """Return a value with its unit, converted from its SI unit if that is another one."""
    label = unit.replace("*", "·").replace("^2", "²")
    return f"{in_unit_of(unit, value, digits, si_unit)}{SPACE}{label}"


def in_unit_of(unit: str, value: float, digits: int, si_unit: str = "") -> str:
    """Return a value as :func:`told` does, without the unit."""
    return plain(value * in_unit(unit, si_unit or {"mm": "m"}.get(unit, unit)), digits)


def plain(value: float, digits: int = 4) -> str:
    """Return a number for reading, as the report has it but in plain text."""
    mantissa, _, power = number(value, digits).partition("<sup>")
    return mantissa + power.removesuffix("</sup>").translate(_POWERS)


def degrees(value: float) -> str:
    """Return an error (deg) for reading; below a thousandth, that it is."""
    return f"{plain(value, 2)}°" if not abs(value) < NO_ERROR else f"below {NO_ERROR:g}°"


def signed(value: float, decimals: int) -> str:
    """Return a number with fixed decimals and its sign; zero has none."""
    text = fixed(value, decimals)
    is_zero = not text.strip("−0.")
    return text.lstrip("−") if is_zero else text if text.startswith("−") else f"+{text}"


def off(error: float, tolerance: float) -> str:
    """Return an error with its tolerance, both to the tolerance's first digit, four decimals at least."""
    if not tolerance:
        return signed(error, 4)
    decimals = max(4, -math.floor(math.log10(tolerance)))
    return f"{signed(error, decimals)}{SPACE}±{SPACE}{fixed(tolerance, decimals)}"


def short_of(value: float, asked: float) -> str:
    """Return a value that falls short with two decimals, or as many as show that it does."""
    decimals = next((n for n in range(2, 10) if round(value, n) < asked), 10)
    return fixed(value, decimals)


def factor(value: float) -> str:
    """Return a factor for reading."""
    return plain(value, 4)


def more(count: int, what: str) -> Sequence[str]:
    """Return what says that so many are left out, nothing if none is."""
    return [f"{count} {what}{'s' if count > 1 else ''} left out: no room on this page"] if count > 0 else []


def masses(kilograms: Iterable[float], most: int) -> str:
    """Return masses (kg) as what to take from the box, heaviest first, the lightest beyond so many kinds summed up."""
    kinds = sorted(Counter(kilograms).items(), reverse=True)
    named = [f"{count}{SPACE}×{SPACE}{_mass(mass)}" if count > 1 else _mass(mass) for mass, count in kinds[:most]]
    rest = kinds[most:]
    if rest:
        pieces, total = sum(count for _, count in rest), sum(mass * count for mass, count in rest)
        named.append(f"{pieces} smaller, not listed, of {_mass(total)} in all")
    return " + ".join(named) or "nothing"


def _mass(mass: float) -> str:
    unit = "kg" if mass >= 1 else "g" if mass >= 1e-3 else "mg"
    return told(mass, unit, 6, "kg")


def symbols(name: str) -> str:
    """Return the name of a group as it is printed."""
    for word, symbol in _SYMBOLS.items():
        name = name.replace(word, symbol)
    return name
