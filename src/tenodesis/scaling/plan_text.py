"""How a workshop plan writes values, masses and symbols: in plain text, for HTML and PDF alike."""

import math
from collections import Counter
from collections.abc import Iterable

from tenodesis.report.content import fixed, number, unit_text
from tenodesis.units import in_unit

SPACE = "\u00a0"
"""Separator of a number and its unit, without a line break."""

NO_ERROR = 1e-3
"""Angle, deg, below which an error is shown as none."""

MOST_MASSES = 12
"""Largest number of different masses listed individually."""

_POWERS = str.maketrans("0123456789−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_SYMBOLS = {"Theta": "Θ", "theta": "θ", "kappa": "κ", "zeta": "ζ", "phi": "φ", "mu": "μ", "^2": "²"}


def quantity(value: float, unit: str, digits: int, si_unit: str = "") -> str:
    """Return a value with its unit, converted from the SI unit if they differ."""
    return f"{converted(value, unit, digits, si_unit)}{SPACE}{unit_text(unit)}"


def converted(value: float, unit: str, digits: int, si_unit: str = "") -> str:
    """Return a value as :func:`quantity` does, without the unit."""
    return plain(value * in_unit(unit, si_unit or {"mm": "m"}.get(unit, unit)), digits)


def plain(value: float, digits: int = 4) -> str:
    """Return a number as reports write it, in plain text."""
    mantissa, _, power = number(value, digits).partition("<sup>")
    return mantissa + power.removesuffix("</sup>").translate(_POWERS)


def angle(error: float) -> str:
    """Return an error (deg), "below 0.001°" for smaller errors."""
    return f"{plain(error, 2)}°" if not abs(error) < NO_ERROR else f"below {NO_ERROR:g}°"


def signed(value: float, decimals: int) -> str:
    """Return a number with fixed decimals and its sign; zero has none."""
    text = fixed(value, decimals)
    is_zero = not text.strip("−0.")
    return text.lstrip("−") if is_zero else text if text.startswith("−") else f"+{text}"


def with_tolerance(error: float, tolerance: float) -> str:
    """Return an error with its tolerance, both to the tolerance's first digit, four decimals at least."""
    if not tolerance:
        return signed(error, 4)
    decimals = max(4, -math.floor(math.log10(tolerance)))
    return f"{signed(error, decimals)}{SPACE}±{SPACE}{fixed(tolerance, decimals)}"


def falling_short(value: float, required: float) -> str:
    """Return a value that falls short of a requirement, with enough decimals (at least two) to show it."""
    decimals = next((n for n in range(2, 10) if round(value, n) < required), 10)
    return fixed(value, decimals)


def masses(kilograms: Iterable[float]) -> str:
    """Return masses (kg) as a list of weights, heaviest first; beyond a number of kinds the lightest are summed."""
    kinds = sorted(Counter(kilograms).items(), reverse=True)
    listed = [
        f"{count}{SPACE}×{SPACE}{_mass(mass)}" if count > 1 else _mass(mass) for mass, count in kinds[:MOST_MASSES]
    ]
    rest = kinds[MOST_MASSES:]
    if rest:
        pieces, total = sum(count for _, count in rest), sum(mass * count for mass, count in rest)
        listed.append(f"{pieces} smaller, not listed, of {_mass(total)} in all")
    return " + ".join(listed) or "nothing"


def _mass(mass: float) -> str:
    unit = "kg" if mass >= 1 else "g" if mass >= 1e-3 else "mg"
    return quantity(mass, unit, 6, "kg")


def symbols(name: str) -> str:
    """Return the name of a group with Greek letters."""
    for word, symbol in _SYMBOLS.items():
        name = name.replace(word, symbol)
    return name
