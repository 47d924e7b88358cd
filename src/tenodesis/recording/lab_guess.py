"""A map of a laboratory's table, guessed from headings, units and ranges, with what to check beside each line."""

import re
from collections.abc import Mapping, Sequence
from math import degrees
from typing import NamedTuple

import numpy as np

from tenodesis.recording.lab_map import COLUMNS, TIME, ColumnHeading, heading, recognised
from tenodesis.recording.lab_tables import LabTable
from tenodesis.run import Array

_TENDON, _SPOOL = r"(tension|cable|tendon|seil|zug|kraft|loadcell|lc)", r"(spool|motor|winch|spule)"
_FIRST, _SECOND = r"(1|a|ago|agonist|left|links)(_.*)?", r"(2|b|anta|antagonist|right|rechts)(_.*)?"
_WORDS = {
    TIME: r"time|t|zeit|temps|x_value|timestamp|seconds?|clock",
    "handle_angle": r".*(handle|griff|theta_?h|input|master|mtm|command|setpoint).*|q_?in",
    "measured_handle_angle": r".*(handle|master|mtm).*measured.*",
    "measured_output_angle": r".*(output|tip_?(angle|measured)|spitze|theta_?[eo]|distal|jaw|wrist|camera).*|q_?out",
    "tension_agonist": rf".*{_TENDON}.*_?{_FIRST}|[ft]_?(1|a)",
    "tension_antagonist": rf".*{_TENDON}.*_?{_SECOND}|[ft]_?(2|b)",
    "force": r"f|force|kraft|load|last|tip_?force|f_?tip|fx|.*_cf_force_?x",
    "spool_agonist": rf".*{_SPOOL}.*_?{_FIRST}",
    "spool_antagonist": rf".*{_SPOOL}.*_?{_SECOND}",
}
"""What headings may be called, by column."""
_FEW, _MOST = 2e-5, 0.5
"""Interval of a clock, s."""
_LARGEST_RADIANS = 3.9
_LARGEST_NEWTONS = 1e3
_NANOSECONDS = 1e9


SIGNS = "a positive handle angle winds the agonist, and a positive force opposes positive flexion;"


class Guess(NamedTuple):
    """What a column is taken for: the table's headings, a unit of each, and a factor."""

    columns: tuple[str, ...]
    units: tuple[str, ...]
    factor: int = 1


def guess(table: LabTable) -> dict[str, Guess]:
    """Return what each of :data:`tenodesis.recording.lab_map.COLUMNS` and the time most likely is; less may be found.

    A heading counts first, by its words, then its unit. Without a unit an angle that moves further than any handle in
    rad is in deg, a tension larger than any tendon bears in N is in mN. Tensions that are negative have factor -1.
    """
    places, _ = recognised("headings", table.headings)
    found = {
        column: Guess(tuple(table.headings[part.at] for part in parts), tuple(part.unit for part in parts))
        for column, parts in places.items()
    }
    values = dict(zip(table.headings, table.columns, strict=True))
    clock = found.get(TIME) or _clock(values)
    if clock is not None:
        found[TIME] = clock
    used = {name for one in found.values() for name in one.columns}
    free = [name for name in values if name not in used]
    free.sort(key=lambda name: "setpoint" not in name)  # of a bag, what was commanded is taken for the handle first
    for column, si in COLUMNS.items():
        if column in _WORDS and column not in found:
            name = next((one for one in free if _is(column, one, si)), None)
            if name is not None:
                free.remove(name)
                found[column] = _with_unit(name, values[name], column, si)
    angles = [name for name in ("handle_angle", "measured_output_angle", "measured_handle_angle") if name in found]
    if any(found[name].units == ("deg",) for name in angles):
        # of one file, angles without a unit are in the same
        for name in angles:
            if clean(found[name].columns[0]).unit is None:
                found[name] = found[name]._replace(units=("deg",))
    return found


def as_toml(
    table: LabTable,
    guesses: dict[str, Guess],
    units: Mapping[str, str] = COLUMNS,
    needed: Sequence[str] | None = None,
    signs: str = SIGNS,
) -> str:
    """Return a commented map: a line per guess, what is missing, and every column that was left over.

    `units` are those of all columns that there may be, `needed` what is missing, `signs` a sentence on signs.
    """
    lines = [f"# Columns of a file ({table.kind}), guessed from headings, units and ranges: check each line.", ""]
    for column in dict.fromkeys((TIME, *units)):
        if column not in guesses:
            continue
        one = guesses[column]
        names, given = (repr_toml(part) for part in (one.columns, one.units))
        factor = f", factor = {one.factor}" if one.factor != 1 else ""
        why = "" if clean(one.columns[0]).unit else ", the unit by its range"
        lines.append(f"# {_range(table, one)}{why}")
        key = repr_toml([column]) if "." in column else column
        lines.append(f"{key} = {{ column = {names}, unit = {given}{factor} }}")
    needed = lacking(guesses) if needed is None else needed
    if needed:
        lines += ["", f"# Not found, and needed by tenodesis identify: {', '.join(needed)}. As an example:"]
        keys = {name: repr_toml([name]) if "." in name else name for name in needed}
        si = {TIME: "s", **units}
        lines += [f'# {keys[name]} = {{ column = "HEADING", unit = "{si.get(name, "rad")}" }}' for name in needed]
    used = {name for one in guesses.values() for name in one.columns}
    rest = [name for name in table.headings if name not in used]
    lines += ["", f"# Signs: {signs}", "# factor = -1 turns one round."]
    if rest:
        lines += ["#", "# Not taken:"]
        lines += [f"#   {_range(table, Guess((name,), ('',)))}" for name in rest]
    return "\n".join(lines) + "\n"


def lacking(guesses: dict[str, Guess]) -> list[str]:
    """Return the columns that an identification needs and no heading was taken for."""
    return [name for name in (TIME, "handle_angle", "tension_agonist", "tension_antagonist") if name not in guesses]


def repr_toml(texts: Sequence[str]) -> str:
    """Return texts as a TOML string, or of several an array of them."""
    quoted = ['"' + re.sub(r'[\x00-\x1f"\\\x7f]', lambda c: f"\\u{ord(c[0]):04x}", text) + '"' for text in texts]
    return quoted[0] if len(quoted) == 1 else f"[{', '.join(quoted)}]"


def _is(column: str, name: str, si: str) -> bool:
    """Return whether a heading can be a column: by its words, unless its unit says otherwise."""
    unit = clean(name).unit
    if name.startswith("/") and si == "rad" and unit is None:
        return False  # of a bag only angles have the unit of one
    word = re.sub(r"[^a-z0-9_]", "", re.sub(r"[ /]", "_", _word(name)))
    return bool(re.fullmatch(_WORDS[column], word)) and (unit is None or _kind(unit) in (si, ""))


def clean(text: str) -> ColumnHeading:
    """Return a heading's parts, with a unit also as in ``Kraft/N``, ``Zeit in ms`` and ``tip (deg)``."""
    found = heading(text)
    other = re.fullmatch(r"(?P<name>.+?)\s*(?:/|\sin\s|\()\s*(?P<unit>m?N|k?gf|lbf|°|deg|m?rad|[mun]?s)\)?", found.name)
    return found if other is None or found.unit is not None else ColumnHeading(other["name"], other["unit"])


def _word(name: str) -> str:
    """Return a heading's name in lower case: of a structure or group the last part, of a bag topic and joint."""
    name = clean(name).name
    if name.startswith("/"):
        return re.sub(r"[./]", "_", re.sub(r"\.(position|velocity|effort|data)$", "", name.lower()).strip("/"))
    return re.split(r"[./]", name)[-1].lower()


def _kind(unit: str) -> str:
    if re.fullmatch(r"(m|u|k)?N|gf|kgf|lbf", unit):
        return "N"
    return "rad" if re.fullmatch(r"m?rad|deg|°|degrees?|radians?", unit) else unit and "?"


def _with_unit(name: str, values: Array, column: str, si: str) -> Guess:
    stated = clean(name).unit
    known = values[np.isfinite(values)]
    spread = float(np.ptp(np.quantile(known, [0.05, 0.95]))) if known.size else 0.0
    if si == "rad":
        unit = "deg" if spread > _LARGEST_RADIANS else "rad"
    else:
        unit = "mN" if spread > _LARGEST_NEWTONS else "N"
    pushed = column.startswith("tension") and known.size > 0 and float(np.median(known)) < 0
    return Guess((name,), (stated or unit,), -1 if pushed else 1)


def _clock(values: dict[str, Array]) -> Guess | None:
    """Return the clock: seconds and nanoseconds in two columns, or one that rises at a plausible rate."""
    named = [name for name in values if re.fullmatch(_WORDS[TIME], _word(name))]
    parts = {_word(name): name for name in values}
    for pair in (("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec")):
        if all(part in parts for part in pair):
            first, second = (parts[part] for part in pair)
            if np.nanmax(values[second], initial=0.0) < _NANOSECONDS:
                return Guess((first, second), ("s", "ns"))
    for name in [*named, *(one for one in values if one not in named)]:
        step = np.diff(values[name][np.isfinite(values[name])])
        if not step.size or (step < 0).mean() > 0.01 or not np.median(step) > 0:
            continue
        unit = clean(name).unit
        units = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
        fits = [one for one, scale in units.items() if _FEW <= np.median(step) * scale <= _MOST]
        if unit in units or (fits and name in named) or (fits and np.ptp(step) < 1e-3 * np.median(step)):
            return Guess((name,), (unit if unit in units else fits[0],))
    return None


def _range(table: LabTable, one: Guess) -> str:
    parts = []
    for name, unit in zip(one.columns, one.units, strict=True):
        values = table.columns[table.headings.index(name)]
        known = values[np.isfinite(values)]
        span = f"{known.min():.5g} to {known.max():.5g}" if known.size else "no number"
        turn = f" (to {degrees(float(np.abs(known).max())):.3g} deg)" if unit == "rad" and known.size else ""
        parts.append(f"{name!r}: {span}{f' {unit}' if unit else ''}{turn}")
    return ", ".join(parts)
