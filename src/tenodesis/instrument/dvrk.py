"""Tool files of the da Vinci Research Kit (dVRK): a wrist as joints and tendons, from its matrix of couplings.

A tool file has the angles of roll, pitch, yaw and jaw by the turns of four disks. Every disk winds a pair of tendons on
spools of one radius; the arms of a pair about the joints are the spool's radius times the disk's row of the inverse
matrix, with the angles of the two jaws in place of yaw and jaw: yaw + jaw/2 and yaw - jaw/2 where the file's jaw angle
is that between the jaws, yaw + jaw and yaw - jaw where it is each jaw's own.

A snake has two joints of pitch and two of yaw, pitch, yaw, yaw, pitch, tied such that either two turn by the file's
angle, and jaws on an axis of their own that one disk turns against each other.
"""

import json
import math
import re
from pathlib import Path
from textwrap import wrap
from typing import Any, Literal, TypeAlias, TypeGuard, get_args

import numpy as np
import tomli_w

from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.files import read_regular
from tenodesis.instrument.full_form import FullForm
from tenodesis.instrument.instrument import Array
from tenodesis.instrument.reading import parse

JawAngle: TypeAlias = Literal["between", "each", "pulleys"]
"""What a file's jaw angle is: that between the jaws, that of each jaw from the middle, or what of either makes a disk
turn one jaw alone, as pulleys do."""

PULLEY_RADIUS = 2.5e-3
"""Radius of the largest pulley about the pitch axis that is assumed, m: it fits into a stem of 8 mm."""

DVRK_UNKNOWN = (
    ("size of pulleys and spools", "--pulley-radius", "a caliper"),
    ("stiffness of the tendons", "100 N/mm", "a known load at the locked tip"),
    ("pretension", "20 N", "a load cell, or the load at slack"),
    ("friction", "none", "currents or tensions both ways"),
    ("play, offsets, coupling as built", "none, zero, the file's matrix", "identify, command and angle"),
    ("length of the end-effector", "10 mm", "a caliper"),
)
"""What a tool file does not say, what is assumed for it, and what would tell."""

_LARGEST = 1_000_000
"""Largest tool file, bytes."""
_MOST = math.radians(179)
"""Largest range that a joint can have, rad."""
_NAMES = ("roll", "pitch", "yaw")
_JAW = 10e-3
"""Length of the end-effector, m: no file has one."""
_SNAKE = ("roll", "pitch_1", "yaw_1", "yaw_2", "pitch_2", "jaw_1", "jaw_2")
_TIED: dict[str, dict[str, Any]] = {
    "yaw_2": {"tied_to": "yaw_1"},
    "pitch_2": {"tied_to": "pitch_1"},
    "jaw_2": {"tied_to": "jaw_1", "tie_ratio": -1.0},
}
"""Keys of a snake's joints that turn with others, by name."""
_MOST_CONDITION = 1e6
"""Condition number above which a matrix is singular, for the six digits that files have."""
# Strings stay as they are: two slashes may stand in them.
_JAW_MEANING: dict[JawAngle, str] = {
    "between": "that between the jaws",
    "each": "each jaw's own, from the middle",
    "pulleys": "what makes a disk turn one jaw alone",
}
_COMMENT = re.compile(r'("(?:[^"\\\n]|\\.)*")|//[^\n]*|/\*.*?\*/', re.DOTALL)
_OURS = {
    "joints.radius": "ours: the file has ratios of radii only; the largest one about the pitch axis is given",
    "joints.range": "the file's limits, with zero, at most 179 deg; of a jaw, yaw's and what the jaw angle adds",
    "spool_radius": "ours: one for all disks; it follows from the pitch pulley's radius",
    "joints.end_effector_length": "ours: the file has none",
    "tendon_stiffness": "ours: at 2.5 mm near the compliance of a da Vinci grasper, docs/identification.md",
    "pretension": "ours: at 2.5 mm near the pretension of a da Vinci grasper, docs/identification.md",
}


def from_dvrk(path: str | Path, *, pulley_radius: float = PULLEY_RADIUS, jaw_angle: JawAngle = "between") -> FullForm:
    """Read a tool file of the da Vinci Research Kit as joints and tendons.

    Parameters
    ----------
    path
        The file, JSON with comments.
    pulley_radius
        Radius of the largest pulley about the pitch axis, m; all others, and the spools', scale with it.
    jaw_angle
        What the file's jaw angle is: that between the jaws, that of each jaw from the middle, or as pulleys have it,
        which turn one jaw each; files do not say it.

    Raises
    ------
    InstrumentError
        It cannot be read, is no tool file, or its wrist is none of pitch, yaw and jaws on one axis.
    ArgumentError
        There is no such jaw angle.
    """
    return parse(dvrk_text(path, pulley_radius=pulley_radius, jaw_angle=jaw_angle), str(path)).expanded


def jaw_reading(path: str | Path, jaw_angle: JawAngle = "between") -> str | None:
    """Return how the jaw angle of a tool file is read, and what any reading means.

    None for a tool without jaws, or with jaws that one disk turns against each other.
    Of a wrist of pulleys one would expect that a disk turns one jaw alone. Arguments and errors as of
    :func:`from_dvrk`.
    """
    content = _content(Path(path))
    matrix, limits = _couplings(content, Path(path))
    return _reading(matrix, jaw_angle) if len(limits) > len(_NAMES) and not content.get("snake-like") else None


def dvrk_text(path: str | Path, *, pulley_radius: float = PULLEY_RADIUS, jaw_angle: JawAngle = "between") -> str:
    """Return the text of the instrument file that :func:`from_dvrk` reads; arguments and errors as there."""
    if jaw_angle not in _JAW_MEANING:
        raise ArgumentError(key="jaw_angle", value=jaw_angle, allowed=" or ".join(get_args(JawAngle)))
    path = Path(path)
    content = _content(path)
    (matrix, limits), stem = _couplings(content, path), _length(_dh_joint(content, 0), "D")
    jaws = len(matrix) > len(_NAMES)
    if np.linalg.cond(matrix) > _MOST_CONDITION:
        raise _refused(
            path, "coupling.ActuatorToJointPosition is singular: turns of the disks leave every angle unchanged", matrix
        )
    is_snake = bool(content.get("snake-like"))
    if is_snake and not jaws:
        raise _refused(path, "snake-like is true, but jaw.ftmax is 0", 0, "a tool with jaws")
    names = _SNAKE if is_snake else ("roll", "pitch", "jaw_1", "jaw_2") if jaws else _NAMES
    turns = np.linalg.inv(_with_jaws(matrix, jaw_angle) if jaws and not is_snake else matrix)
    share = _jaw_share(matrix, jaw_angle) if jaws else 0.0
    ranges = [_both_sides(*limit) for limit in limits]
    if is_snake:
        # Half of a tendon's excursion at either of two tied joints; the jaws turn against each other.
        half = turns[:, 1:3] / 2
        turns = np.column_stack([turns[:, 0], half, half[:, ::-1], turns[:, 3:] * (np.array([1, -1]) / (2 * share))])
        closed, opened = (share * limit for limit in ranges[3])
        ranges = [*ranges[:3], ranges[2], ranges[1], (closed, opened), (-opened, -closed)]
    elif jaws:
        (low, high), (closed, opened) = ranges[2:]
        ranges[2:] = [
            _both_sides(low + share * closed, high + share * opened),
            _both_sides(low - share * opened, high - share * closed),
        ]
    pulleys = np.abs(turns).max(axis=0)
    spool = pulley_radius / pulleys[1]
    values: dict[str, Any] = {
        "name": path.stem.lower().replace("_", "-"),
        "description": "Imported from a tool file of the da Vinci Research Kit",
        "stem_diameter": "5 mm" if is_snake else "8 mm",
        "spool_radius": _mm(spool),
        "pretension": "20 N",
        "tendon_stiffness": "100 N/mm",
        "joints": [
            _joint(name, spool * pulleys[i], ranges[i], _before(name, content, is_snake))
            for i, name in enumerate(names)
        ],
        "tendons": [
            {"name": f"disk_{disk}_{way}", "route": _route(names, sign * spool * row)}
            for disk, row in enumerate(turns, 1)
            for way, sign in (("wound", 1), ("unwound", -1))
        ],
    }
    for joint in values["joints"] if is_snake else ():
        joint.update(_TIED.get(joint["name"], {}))
    if stem > 0:
        values["stem_length"] = _mm(stem)
    if jaws:
        values["grip"] = {"jaws": list(names[-2:])}
    values["sources"] = {
        "joints": f"coupling, limits and DH parameters of {path.name}",
        **_OURS,
        "stem_diameter": "ours: of the da Vinci S and Si tools" + ", those with a snake" * is_snake,
    }
    kind = "roll, pitch, and two jaws on the yaw axis" if jaws else "roll, pitch, and yaw"
    if is_snake:
        kind = "roll, two joints of pitch and two of yaw, tied, and jaws"
    head = (
        f"# {path.name} of the da Vinci Research Kit: {kind}.\n"
        "# Turns of its disks, each of which winds a pair of tendons on spools of one radius, give the file's angles.\n"
        "# [sources] lists what is not in the file.\n"
    )
    if jaws and not is_snake:
        head += "".join(f"# {line}\n" for line in wrap(_reading(matrix, jaw_angle), 118))
    return head + "\n" + tomli_w.dumps(dict(sorted(values.items(), key=lambda one: isinstance(one[1], list | dict))))


def _jaw_share(matrix: Array, jaw_angle: JawAngle) -> float:
    """Return how much of the file's jaw angle a jaw turns from the middle."""
    yaw, jaw = np.abs(matrix[2:, np.flatnonzero(matrix[3])]).sum(axis=1)
    # a disk that turns jaws against each other says nothing of it
    return {"between": 0.5, "each": 1.0, "pulleys": float(yaw / jaw) or 0.5}[jaw_angle]


def _with_jaws(matrix: Array, jaw_angle: JawAngle) -> Array:
    """Return the matrix with the angles of the two jaws in place of yaw and jaw."""
    share = _jaw_share(matrix, jaw_angle)
    return np.vstack([matrix[:2], matrix[2] + share * matrix[3], matrix[2] - share * matrix[3]])


def _reading(matrix: Array, jaw_angle: JawAngle) -> str:
    turned = {
        one: np.sort(np.abs(_with_jaws(matrix, one)[2:, np.flatnonzero(matrix[3])]), axis=0) for one in _JAW_MEANING
    }
    by = {one: f"{100 * (least / most).max():.0f} %" for one, (least, most) in turned.items()}
    others = [
        f"taken as {words} (--jaw-angle {one}), it is {by[one]}"
        for one, words in _JAW_MEANING.items()
        if one != jaw_angle
    ]
    return (
        f"The file's jaw angle is taken as {_JAW_MEANING[jaw_angle]}: a disk that turns a jaw turns the other one by "
        f"up to {by[jaw_angle]} of it; {'; '.join(others)}."
    )


def _both_sides(low: float, high: float) -> tuple[float, float]:
    """Return a range that has zero within it, rad."""
    return max(min(low, 0.0), -_MOST), min(max(high, 0.0), _MOST)


def _joint(name: str, radius: float, limits: tuple[float, float], offset: tuple[str | None, float]) -> dict[str, Any]:
    jaws, (on, before) = name.startswith("jaw"), offset
    low, high = (f"{math.degrees(limit):.9g} deg" for limit in limits)
    joint = {
        "name": name,
        "mechanism": "pulley",
        "axis": "yaw" if jaws else name.partition("_")[0],
        "on": on,
        "radius": _mm(radius),
        "offset": _mm(before) if before else None,
        "range": high if low == f"-{high}" else [low, high],
        "end_effector_length": _mm(_JAW) if jaws or name == "yaw" else None,
    }
    return {key: value for key, value in joint.items() if value is not None}


def _before(name: str, content: dict[str, Any], is_snake: bool) -> tuple[str | None, float]:
    """Return what a joint stands on, if not on the one before it, and how far from it, m."""
    spacing, jaws = _length(_dh_joint(content, 2), "A"), name.startswith("jaw")
    if not is_snake:
        return ("pitch" if jaws else None), (spacing if jaws or name == "yaw" else 0.0)
    if not jaws:
        return None, (spacing if name in ("yaw_1", "yaw_2", "pitch_2") else 0.0)
    try:
        tip = float(np.linalg.norm(np.array(content.get("tooltip_offset"), float)[:3, 3]))
    except (TypeError, ValueError, IndexError):
        tip = _JAW
    return "pitch_2", max(tip - _JAW, 0.0)


def _route(names: tuple[str, ...], arms: Array) -> list[dict[str, str]]:
    return [
        {"joint": name, "side": "agonist" if arm > 0 else "antagonist", "radius": _mm(abs(arm))}
        for name, arm in zip(names, arms.tolist(), strict=True)
        # what is left of zeros by the inversion
        if abs(arm) > 1e-14
    ]


def _mm(length: float) -> str:
    return f"{1e3 * length:.15g} mm"


def _content(path: Path) -> dict[str, Any]:
    needed = "a tool file of the da Vinci Research Kit, JSON"
    try:
        text = read_regular(path, _LARGEST).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InstrumentError(f"{path} is not UTF-8 text; it must be {needed}.", key="path", value=path) from None
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or failure
        raise InstrumentError(f"{path} cannot be read: {reason}.", key="path", value=path) from None
    try:
        content = json.loads(_COMMENT.sub(lambda found: found[1] or " ", text))
    except (ValueError, RecursionError) as failure:
        raise InstrumentError(
            f"{path} is not JSON: {failure}; it must be {needed}.", key="path", value=path, allowed=needed
        ) from None
    if not isinstance(content, dict):
        raise _refused(path, "is no object of keys", content, needed)
    return content


def _matrix(content: dict[str, Any], path: Path) -> Array:
    coupling = content.get("coupling")
    key = "coupling.ActuatorToJointPosition"
    if not isinstance(coupling, dict) or "ActuatorToJointPosition" not in coupling:
        raise _refused(path, f"{key} is missing", None, "given")
    needed = "4 rows of 4 finite numbers"
    try:
        matrix = np.array(coupling["ActuatorToJointPosition"], dtype=np.float64)
    except (TypeError, ValueError):
        raise _refused(path, f"{key} is no matrix of numbers", None, needed) from None
    if matrix.shape != (4, 4):
        raise _refused(path, f"{key} has the shape {matrix.shape}", matrix.shape, needed)
    if not np.isfinite(matrix).all():
        raise _refused(path, f"{key} has a number that is not finite", matrix, needed)
    return matrix


def _couplings(content: dict[str, Any], path: Path) -> tuple[Array, list[tuple[float, float]]]:
    """Return the matrix and the larger limits of roll, pitch, yaw and jaw, rad; no jaw where no torque moves it."""
    matrix = _matrix(content, path)
    limits = [_limits(_dh_joint(content, place), f"DH.joints, {name}", path) for place, name in enumerate(_NAMES)]
    jaw = content.get("jaw")
    if isinstance(jaw, dict) and jaw.get("ftmax") == 0:
        return _without_jaws(matrix, path), limits
    return matrix, [*limits, _limits(jaw, "jaw", path)]


def _dh_joint(content: dict[str, Any], place: int) -> Any:
    dh = content.get("DH")
    joints = dh.get("joints") if isinstance(dh, dict) else None
    return joints[place] if isinstance(joints, list) and len(joints) > place else None


def _limits(joint: Any, key: str, path: Path) -> tuple[float, float]:
    values = [joint.get(bound) for bound in ("qmin", "qmax")] if isinstance(joint, dict) else []
    numbers = [one for one in values if _is_number(one)]
    if not any(numbers) or len(numbers) < len(values):
        found = values if values else "missing"
        needed = "two finite numbers, not both zero"
        raise InstrumentError(
            f"{path}: qmin and qmax of {key} are {found}; they must be {needed}.",
            key="path",
            value=found,
            allowed=needed,
        )
    return float(min(numbers)), float(max(numbers))


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _length(joint: Any, key: str) -> float:
    """Return a length of a joint's DH parameters, m: D of the stem, A to the axis before; 0 where it has none."""
    value = joint.get(key) if isinstance(joint, dict) else None
    return abs(float(value)) if _is_number(value) else 0.0


def _without_jaws(matrix: Array, path: Path) -> Array:
    """Return the matrix of a tool without jaws, whose last disk is not used."""
    if matrix[3, :3].any() or matrix[:3, 3].any():
        raise _refused(
            path,
            "jaw.ftmax is 0, but coupling.ActuatorToJointPosition couples the jaw with other angles",
            matrix,
            "zero beside the diagonal in its last row and column",
        )
    return matrix[:3, :3]


def _refused(path: Path, problem: str, value: object, allowed: str = "regular") -> InstrumentError:
    return InstrumentError(f"{path}: {problem}; it must be {allowed}.", key="path", value=value, allowed=allowed)
