"""A controller's parameters as a C header, for a program without Python: firmware, LabVIEW, Simulink."""

import keyword
import re
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from tenodesis import _core
from tenodesis.control.controller import ActuationName, Controller, LawName, ObserverName
from tenodesis.control.joints import JointController, JointLawName
from tenodesis.control.pairs import compensated
from tenodesis.control.parameters import FAULTS, safe_state
from tenodesis.errors import ArgumentError
from tenodesis.files import atomic_file
from tenodesis.instrument import FullForm, InstrumentLike, ShortForm, expanded
from tenodesis.instrument.joints import MECHANISMS

INTERFACE_VERSION: int = _core.INTERFACE_VERSION
"""TENODESIS_VERSION of the C interface that headers are written for."""

_COMMON, _AXIS = (
    {name: f"{unit}: {meaning}" for name, unit, meaning in rows}
    for rows in (_core.control_parameters(), _core.control_axis_parameters())
)
JOINTS_VERSION: int = _core.JOINTS_VERSION
"""TENODESIS_JOINTS_VERSION of the C interface of all joints that headers are written for."""

_NUMBERS = {name: f"{unit}: {meaning}" for name, unit, meaning in _core.joint_control_parameters()}
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
        *_head(inst.name if source is None else source, INTERFACE_VERSION, choices),
        f" * {_HOMED if homed else _NOT_HOMED}",
        *_opened(name),
        '#include "tenodesis/tenodesis.h"',
        *_of_version("TENODESIS_VERSION", INTERFACE_VERSION),
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
        f"    .observe = TENODESIS_OBSERVE_{_constant(inst.control.observe)},",
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


def joints_header(
    inst: InstrumentLike,
    name: str | None = None,
    *,
    law: JointLawName = "joints",
    own_clock: bool = False,
    shows_load: bool = False,
    source: str | None = None,
) -> str:
    """Return a C header that defines an instrument's ``tenodesis_joints_parameters`` and the sizes of its controller.

    Parameters
    ----------
    inst, name, own_clock, source
        As of :func:`header`.
    law
        As of :class:`~tenodesis.control.JointController`.
    shows_load
        Whether the controller's output has the load at the tip.

    Raises
    ------
    ValueError
        The name is not valid in C, or the parameters make no controller.
    """
    given = expanded(inst)
    controller = JointController(given, law)
    name = identifier(given.name) if name is None else _checked(name)
    rows = controller.rows
    sizes = {"JOINTS": len(given.tip_joints), "TENDONS": len(given.tendons), "CONTACTS": max(rows.contacts)}
    n, m = sizes["JOINTS"], sizes["TENDONS"]
    prepared = np.split(np.array(controller.core.prepared), [n * n, 2 * n * n])
    handle = [MECHANISMS[joint.mechanism] for joint in given.handle_joints]
    lines = [
        f"/* The controller of all joints of {_comment(given.name)} for tenodesis_joints_init:",
        f" * {', '.join(_comment(joint.name) for joint in given.tip_joints)}.",
        *_head(
            given.name if source is None else source,
            JOINTS_VERSION,
            "its own clock" if own_clock else "the input's clock",
        ),
        " * Spools are at the pretension and joints straight where spool angles count from. Build src/c/joints.cpp by",
        " * -include of this header, and of no other.",
        *_opened(name),
        *(
            f"#ifndef TENODESIS_{key}\n#define TENODESIS_{key} {size}\n#elif TENODESIS_{key} != {size}\n"
            f'#error "another instrument\'s size: TENODESIS_{key}"\n#endif'
            for key, size in sizes.items()
        ),
        '#include "tenodesis/joints.h"',
        *_of_version("TENODESIS_JOINTS_VERSION", JOINTS_VERSION),
        f"static const tenodesis_joints_parameters {name} = {{",
        "    .size = sizeof(tenodesis_joints_parameters),",
        "    .version = TENODESIS_JOINTS_VERSION,",
        f"    .handles = {len(handle)},",
        f"    .friction_law = {rows.law},",
        f"    .compensates = {int(controller.compensates)},",
        f"    .shows_load = {int(shows_load)},",
        f"    .own_clock = {int(own_clock)},",
        "    .reserved = 0,",
        f"    .handle = {{{', '.join(map(str, handle)) or 0}}},",
        *(f"    .{key} = {_number(controller.numbers[key])}, /* {text} */" for key, text in _NUMBERS.items()),
        f"    .spool_jump = {_limit('spool_jump', controller.limits['spool_jump'])}",
        "    .limit =",
        "        {",
        *(f"            {_limit(fault, controller.limits[fault], fault)}" for fault in FAULTS),
        "        },",
        *_listed("joint", _joints(given), 4),
        *_listed("tendon", _tendons(given, controller), 4),
    ]
    for key, values, width in zip(("within", "response", "settled"), prepared, (n, n, m), strict=True):
        lines += _listed(key, [_row(row) for row in values.reshape(n, width)], 4)
    return "\n".join([*lines, "};", "", "#endif", ""])


def _joints(inst: FullForm) -> list[str]:
    """Return the initialisers of the joints of the tip."""
    names = ("axis_x", "axis_y", "axis_z", "offset", "chord", "length", "stiffness", "hardening")
    found = []
    for joint, parent, row in zip(inst.tip_joints, inst.parents, inst.joint_rows, strict=True):
        *own, to, ratio, stiffness, _, share, grip, within = row
        values = dict(zip(names, own, strict=True)) | {"tie_ratio": ratio, "tie_stiffness": stiffness}
        choices = {
            "mechanism": MECHANISMS[joint.mechanism],
            "within": int(within),
            "parent": parent + 1,
            "tied_to": int(to) + 1,
        }
        found.append(f"{_fields(choices, values | {'share': share, 'grip': grip})} /* {_comment(joint.name)} */")
    return found


def _tendons(inst: FullForm, controller: JointController) -> list[str]:
    """Return the initialisers of the tendons, with their contacts."""
    passages, contacts, segments = controller.rows[:3]
    found = []
    for m, tendon in enumerate(inst.tendons):
        count = contacts[m]
        curve = inst.growth_rows[m] if len(inst.growth_rows) else np.zeros((0, 2))
        curve = curve[np.isfinite(curve[:, 0])]
        choices = {"contacts": count, "motor": int(tendon.start == "spool"), "curve_entries": len(curve), "reserved": 0}
        values = {
            "stiffness": inst.stiffnesses[m],
            "pretension": inst.pretensions[m],
            "end_compliance": 1 / segments[m, count],
        }
        arms = {
            "arm": inst.tendon_arms("tip")[m],
            "handle_arm": inst.tendon_arms("handle")[m],
            "curve_tension": curve[:, 0],
            "curve_ratio": curve[:, 1],
        }
        names = ("compliance", "coefficient", "wrap", "share", "arm", "wound")
        along = [
            _fields(
                {"joint": int(passages[m, j, 0]) + 1, "reserved": 0},
                dict(zip(names, (1 / segments[m, j], *passages[m, j, 1:]), strict=True)),
            )
            for j in range(count)
        ]
        rows = [f"    .{key} = {_row(row)}," for key, row in arms.items()]
        own = _fields(choices, values).removeprefix("{").removesuffix("}")
        lines = [f"{{ /* {_comment(tendon.name)} */", f"    {own},", *rows, *_listed("contact", along, 4), "}"]
        found.append("\n".join(lines))
    return found


def _fields(choices: Mapping[str, int], values: Mapping[str, float]) -> str:
    texts = {key: str(value) for key, value in choices.items()}
    texts |= {key: _number(value) for key, value in values.items()}
    return f"{{{', '.join(f'.{key} = {text}' for key, text in texts.items())}}}"


def _row(values: Iterable[float]) -> str:
    return f"{{{', '.join(map(_number, values)) or '0'}}}"


def _listed(key: str, items: Iterable[str], indent: int) -> list[str]:
    """Return the lines of a field that is a list of initialisers; a comment at an item's end stays behind its comma."""
    lines = [f".{key} =", "    {"]
    for item in items:
        text, mark, comment = item.partition(" /*") if "\n" not in item else (item, "", "")
        lines += textwrap.indent(f"{text},{mark}{comment}", " " * 8).splitlines()
    return [" " * indent + line for line in (*lines, "    },")]


def _head(source: str, version: int, choices: str) -> list[str]:
    return [
        " *",
        f" * Written by tenodesis {_version()} from {_comment(source)},",
        f" * for version {version} of the C interface:",
        f" * {choices}.",
        " *",
    ]


def _opened(name: str) -> list[str]:
    guard = f"TENODESIS_PARAMETERS_{name.upper()}_H"
    return [" */", f"#ifndef {guard}", f"#define {guard}", ""]


def _of_version(macro: str, version: int) -> list[str]:
    return [
        "",
        f"#if {macro} != {version}u",
        '#error "written for another version of the C interface: export the instrument again"',
        "#endif",
        "",
    ]


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
    _write(path, text)


def export_joints_header(
    inst: InstrumentLike,
    path: str | Path,
    name: str | None = None,
    *,
    law: JointLawName = "joints",
    own_clock: bool = False,
    shows_load: bool = False,
    source: str | None = None,
) -> None:
    """Write what :func:`joints_header` returns to a file, atomically; raises as :func:`export_header`."""
    _write(path, joints_header(inst, name, law=law, own_clock=own_clock, shows_load=shows_load, source=source))


def _write(path: str | Path, text: str) -> None:
    with atomic_file(Path(path)) as new:
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
