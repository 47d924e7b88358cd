"""A controller's parameters as a C header, for a program without Python: firmware, LabVIEW, Simulink."""

import keyword
import re
from pathlib import Path

import numpy as np

from tenodesis import _core
from tenodesis.control.controller import ActuationName, Controller, LawName, ObserverName
from tenodesis.control.pairs import compensated
from tenodesis.control.parameters import FAULTS, safe_state
from tenodesis.errors import ArgumentError
from tenodesis.files import atomic_file
from tenodesis.instrument import InstrumentLike, ShortForm

INTERFACE_VERSION: int = _core.INTERFACE_VERSION
"""TENODESIS_VERSION of the C interface that headers are written for."""

_COMMON, _AXIS = (
    {name: f"{unit}: {meaning}" for name, unit, meaning in rows}
    for rows in (_core.control_parameters(), _core.control_axis_parameters())
)
_HOMED = "It starts as homed: only where both tendons have the pretension, and spool angles count from there."
_NOT_HOMED = (
    "It starts as not homed: request TENODESIS_REQUEST_HOME, with a free tip and a still hand, before it compensates."
)
_LIMIT_UNITS = {name: unit for name, unit, _ in _core.faults()} | {"spool_jump": _core.SPOOL_JUMP_UNIT}

# Words of C99 and C++20 that are no keywords in Python.
_RESERVED = frozenset(
    re.findall(
        r"\w+",
        """
        alignas alignof and_eq asm auto bitand bitor bool case catch char char16_t char32_t char8_t co_await co_return
        co_yield compl concept const const_cast consteval constexpr constinit decltype default delete do double
        dynamic_cast enum explicit export extern false float friend goto inline int long mutable namespace new noexcept
        not_eq nullptr operator or_eq private protected public register reinterpret_cast requires restrict short signed
        sizeof static static_assert static_cast struct switch template this thread_local throw true typedef typeid
        typename union unsigned using virtual void volatile wchar_t xor xor_eq
        """,
    )
)


def header(
    inst: InstrumentLike,
    name: str | None = None,
    *,
    observer: ObserverName = "friction",
    law: LawName = "robust",
    actuation: ActuationName = "differential",
    homed: bool = False,
    own_clock: bool = False,
    source: str | None = None,
) -> str:
    """Return a C header that defines an instrument's ``tenodesis_parameters``.

    Every value is exact in double precision, and in single precision the one that Python's controller computes with.

    Parameters
    ----------
    inst
        The instrument; all of its axes.
    name
        Of the constant; by default the instrument's, with underscores.
    observer, law, actuation, own_clock
        As of :class:`~tenodesis.control.Controller`.
    homed
        Whether the program starts with both tendons at the pretension and spool angles counted from there; otherwise
        its controller compensates nothing until it has homed.
    source
        The source that the header names; by default the instrument's name.

    Raises
    ------
    ValueError
        The name is not valid in C, there is no such choice, or the parameters make no controller.
    """
    inst = compensated(inst)
    # Applies the controller's own checks, in the precision that overflows first.
    controller = Controller(inst, observer, law, actuation, homed=homed, precision="single", own_clock=own_clock)
    parameters = controller.parameters
    name = identifier(inst.name) if name is None else _checked(name)
    guard = f"TENODESIS_PARAMETERS_{name.upper()}_H"
    choices = ", ".join(
        [
            f"observer {observer}",
            f"law {law}",
            f"actuation {actuation}",
            "its own clock" if own_clock else "the input's clock",
        ]
    )
    lines = [
        f"/* The controller of {_comment(inst.name)} for tenodesis_init: {' and '.join(map(_comment, inst.axes))}.",
        " *",
        f" * Written by tenodesis {_version()} from {_comment(inst.name if source is None else source)},",
        f" * for version {INTERFACE_VERSION} of the C interface:",
        f" * {choices}.",
        " *",
        f" * {_HOMED if homed else _NOT_HOMED}",
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        '#include "tenodesis/tenodesis.h"',
        "",
        f"#if TENODESIS_VERSION != {INTERFACE_VERSION}u",
        '#error "written for another version of the C interface: export the instrument again"',
        "#endif",
        "",
        f"static const tenodesis_parameters {name} = {{",
        "    .size = sizeof(tenodesis_parameters),",
        "    .version = TENODESIS_VERSION,",
        f"    .joint_type = TENODESIS_{_constant(inst.joint_type)},",
        f"    .axes = {len(inst.axes)},",
        f"    .observer = TENODESIS_OBSERVER_{_constant(observer)},",
        f"    .law = TENODESIS_LAW_{_constant(law)},",
        f"    .actuation = TENODESIS_ACTUATION_{_constant(actuation)},",
        f"    .safe_state = TENODESIS_SAFE_{_constant(safe_state(inst))},",
        f"    .stop = TENODESIS_STOP_{_constant(inst.control.stop)},",
        f"    .own_clock = {int(own_clock)},",
        f"    .homed = {int(homed)},",
        "    .reserved = 0,",
        *(f"    .{key} = {_number(parameters.common[key])}, /* {text} */" for key, text in _COMMON.items()),
        "    .axis =",
        "        {",
    ]
    for axis, own, limits in zip(inst.axes, parameters.axes, parameters.limits, strict=True):
        lines += [
            f"            /* {_comment(axis)} */",
            "            {",
            *(f"                .{key} = {_number(own[key])}, /* {text} */" for key, text in _AXIS.items()),
            f"                .spool_jump = {_limit('spool_jump', limits['spool_jump'])}",
            "                .limit =",
            "                    {",
            *(f"                        {_limit(fault, limits[fault], fault)}" for fault in FAULTS),
            "                    },",
            "            },",
        ]
    return "\n".join([*lines, "        },", "};", "", *_currents(inst, name), "#endif", ""])


def _currents(inst: ShortForm, name: str) -> list[str]:
    """Return what makes tensions of currents, where these are in the place of load cells."""
    of = name.upper()
    sensors = {f"{of}_{axis.upper()}": one.tension_sensor for axis, one in zip(inst.axes, inst.planar, strict=True)}
    if len(set(sensors.values())) == 1:
        sensors = {of: inst.planar[0].tension_sensor}
    lines = ["/* For tenodesis_tension_from_current. */"]
    for prefix, sensor in sensors.items():
        if not sensor.per_current:
            return []
        lines += [
            f"#define {prefix}_TENSION_PER_CURRENT {_number(sensor.per_current)} /* N/A */",
            f"#define {prefix}_CURRENT_RANGE {_number(sensor.range / sensor.per_current)} /* A */",
        ]
    return [*lines, ""]


def export_header(
    inst: InstrumentLike,
    path: str | Path,
    name: str | None = None,
    *,
    observer: ObserverName = "friction",
    law: LawName = "robust",
    actuation: ActuationName = "differential",
    homed: bool = False,
    own_clock: bool = False,
    source: str | None = None,
) -> None:
    """Write what :func:`header` returns to a file, atomically.

    Raises
    ------
    ValueError
        As :func:`header`.
    OSError
        The file cannot be written; an existing file is unchanged.
    """
    text = header(
        inst, name, observer=observer, law=law, actuation=actuation, homed=homed, own_clock=own_clock, source=source
    )
    path = Path(path)
    with atomic_file(path) as new:
        new.write_text(text, "utf-8")


def identifier(text: str) -> str:
    """Return a name in C for a text: ``scaled-up`` becomes ``scaled_up``."""
    name = re.sub(r"[^a-z0-9]+", "_", text.lower(), flags=re.ASCII).strip("_")
    return name if name and not name[0].isdigit() and not _is_reserved(name) else f"instrument_{name}".rstrip("_")


def _is_reserved(name: str) -> bool:
    return keyword.iskeyword(name) or name in _RESERVED or name.startswith(("tenodesis_", "TENODESIS_"))


def _checked(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name, re.ASCII) or _is_reserved(name):
        raise ArgumentError(
            f"name is {name!r}; it must be letters, digits and underscores, beginning with a letter, no word of C or "
            "C++, and must not begin with tenodesis_.",
            key="name",
            value=name,
        )
    return name


def _constant(choice: str) -> str:
    return choice.replace("-", "_").upper()


def _comment(text: str) -> str:
    """Return a text that ends neither a comment nor a line."""
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").split())


def _number(value: float) -> str:
    if not np.isfinite(np.float32(value)):
        raise ArgumentError(f"{value:g} is not finite in single precision.")
    return f"TENODESIS_C({float(value)!r})"


def _limit(key: str, limit: tuple[float, float], comment: str | None = None) -> str:
    threshold, persistence = limit
    label = "" if comment is None else f"{comment}: "
    return f"{{{_number(threshold)}, {_number(persistence)}}}, /* {label}{_LIMIT_UNITS[key]}, s */"


def _version() -> str:
    from tenodesis.version import __version__  # noqa: PLC0415

    return __version__
