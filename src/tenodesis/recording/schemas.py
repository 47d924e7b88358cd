"""The topics of a recording, and the messages that carry the signals of a run on them."""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import coupled
from tenodesis.coupled import CoupledInstrument, CoupledRun
from tenodesis.coupled.twin import signal as coupled_signal
from tenodesis.recording import cdr
from tenodesis.run import SIGNALS, TENDONS, TISSUE, Array, Run, Signal

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
FLOAT64 = "std_msgs/msg/Float64"
STRING = "std_msgs/msg/String"

METADATA = "tenodesis"
"""Name of the metadata record."""

TRANSFERRED = "transferred_from"
"""Key in the metadata of the file that was converted from another instrument."""

TIME = "/time"
"""Topic of the time to the last bit; stamps only count nanoseconds."""

EVENTS = "/events"
"""Topic of the events, each a JSON object in a String."""


_CONTROL_NUMBERS = (
    "friction_scale",
    "friction_scale_std",
    "operating_state",
    "faults",
    "phase",
    "homing_failure",
    "request",
)
"""Signals of a controller that have a topic of their name."""

_WRENCH = {
    f"{vector}.{axis}": f"wrench.{part}{axis}" for vector, part in (("force", "f"), ("torque", "m")) for axis in "xyz"
}
"""Component of a coupled run's wrench in each field of the message."""
_GRIP = {"/rig/grip_force": "applied_grip_force", "/twin/grip_force": "grip_force"}
"""Signals of jaws, by topic."""

_FIELDS = {
    "builtin_interfaces/Time": ("int32 sec", "uint32 nanosec"),
    "std_msgs/Header": ("builtin_interfaces/Time stamp", "string frame_id"),
    "geometry_msgs/Vector3": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/Wrench": ("geometry_msgs/Vector3 force", "geometry_msgs/Vector3 torque"),
    "sensor_msgs/JointState": (
        "std_msgs/Header header",
        "string[] name",
        "float64[] position",
        "float64[] velocity",
        "float64[] effort",
    ),
    "geometry_msgs/WrenchStamped": ("std_msgs/Header header", "geometry_msgs/Wrench wrench"),
    "std_msgs/Float64": ("float64 data",),
    "std_msgs/String": ("string data",),
}


@dataclass(frozen=True)
class CoupledNames:
    """What the columns of a coupled run are named after: joints of the tip, of the handle, and tendons.

    And the joints that a controller compensates, none without one.
    """

    joints: tuple[str, ...]
    handle_joints: tuple[str, ...]
    tendons: tuple[str, ...]
    compensated: tuple[str, ...] = ()

    @classmethod
    def of_instrument(cls, inst: CoupledInstrument, *, controlled: bool = False) -> "CoupledNames":
        """Return the names of an instrument's joints and tendons; controlled: under a controller."""
        pairs = [inst.tip_joints[pair.joint] for pair in coupled.pairs(inst).values()] if controlled else []
        groups = (inst.tip_joints, inst.handle_joints, inst.tendons, pairs)
        return cls(*(tuple(one.name for one in group) for group in groups))

    @classmethod
    def from_texts(cls, texts: Mapping[str, str]) -> "CoupledNames | None":
        """Return the names in a recording's metadata, or None if it is not of a coupled instrument."""
        return cls(*(tuple(texts.get(key, "").split()) for key in _NAMED)) if _NAMED[0] in texts else None

    @property
    def texts(self) -> dict[str, str]:
        """The names as metadata."""
        return {key: " ".join(getattr(self, key)) for key in _NAMED}


_NAMED = tuple(one.name for one in fields(CoupledNames))

Names: TypeAlias = tuple[str, ...] | CoupledNames
"""What the columns of a run are named after: the axes of a planar instrument, or joints and tendons."""

AnyRun: TypeAlias = Run | CoupledRun


class Topic(NamedTuple):
    """A topic: its message type, its joints, and the signal in each of the message's arrays.

    Of a signal's columns, in order of axes and then tendons, the topic carries `columns`.
    """

    name: str
    type: str
    joints: tuple[str, ...]
    signals: Mapping[str, str]
    columns: slice = slice(None)
    frame: str = ""
    copy_of: str | None = None
    """Topic that has its signals, too, from which they are read if there is one."""


def definition(message_type: str) -> str:
    """Return a message's definition with those of its parts, in the form of ``ros2msg``."""
    names = [message_type.replace("/msg/", "/")]
    for name in names:
        parts = (line.split()[0] for line in _FIELDS[name])
        names += [part for part in parts if part in _FIELDS and part not in names]
    separator = "=" * 80
    texts = [
        "".join(f"{line}\n" for line in ([] if name is names[0] else [separator, f"MSG: {name}"]) + [*_FIELDS[name]])
        for name in names
    ]
    return "".join(texts)


def topics(names: Names) -> tuple[Topic, ...]:
    """Return every topic of an instrument with these axes, or these joints and tendons."""
    if isinstance(names, CoupledNames):
        joints = _joint_topics(names.handle_joints, names.joints, names.tendons, names.compensated)
        return (
            Topic(TIME, FLOAT64, (), {"data": "time"}),
            *(topic for topic in joints if topic.joints),
            Topic(_rig(None), WRENCH, (), _WRENCH, frame="tip"),
            *(Topic(topic, FLOAT64, (), {"data": signal}) for topic, signal in _GRIP.items()),
            *_number_topics("controller", _CONTROL_NUMBERS, names.compensated, always=True),
        )
    axes = names
    handle = tuple(f"handle_{axis}" for axis in axes)
    tip = tuple(f"tip_{axis}" for axis in axes)
    tendons = tuple(f"{axis}_{tendon}" for axis in axes for tendon in TENDONS)
    forces = {"force.x": "force", "force.z": "radial_force"}
    return (
        Topic(TIME, FLOAT64, (), {"data": "time"}),
        *_joint_topics(handle, tip, tendons, tip),
        *(
            Topic(_rig(axis if axes[1:] else None), WRENCH, (), forces, slice(i, i + 1), f"tip_{axis}")
            for i, axis in enumerate(axes)
        ),
        *(
            Topic(
                f"/controller/{f'{axis}/' if axes[1:] else ''}measured_cf",
                WRENCH,
                (),
                {"force.x": "estimated_force"},
                slice(i, i + 1),
                f"tip_{axis}",
                copy_of="/controller/tip/measured_js",
            )
            for i, axis in enumerate(axes)
        ),
        *_number_topics("controller", _CONTROL_NUMBERS, axes),
        *_number_topics("twin", TISSUE, axes),
    )


def _number_topics(origin: str, signals: Sequence[str], axes: tuple[str, ...], *, always: bool = False) -> list[Topic]:
    """Return a topic for each signal of each axis, whose name has the axis if there are several, or always."""
    return [
        Topic(
            f"/{origin}/{f'{axis}/' if always or axes[1:] else ''}{signal}",
            FLOAT64,
            (),
            {"data": signal},
            slice(i, i + 1),
        )
        for signal in signals
        for i, axis in enumerate(axes)
    ]


def _joint_topics(
    handle: tuple[str, ...], tip: tuple[str, ...], tendons: tuple[str, ...], compensated: tuple[str, ...]
) -> list[Topic]:
    joint_states = (
        ("/handle/measured_js", handle, {"position": "measured_handle_angle"}),
        ("/handle/setpoint_js", handle, {"position": "commanded_handle_angle"}),
        ("/motors/measured_js", tendons, {"position": "measured_spool_angle"}),
        ("/motors/setpoint_js", tendons, {"velocity": "commanded_spool_velocity"}),
        ("/motors/current", tendons, {"effort": "measured_current"}),
        ("/tendons/measured_js", tendons, {"effort": "measured_tension"}),
        ("/tip/measured2_js", tip, {"position": "measured_output_angle"}),
        ("/twin/handle/measured_js", handle, {"position": "handle_angle", "effort": "handle_torque"}),
        (
            "/twin/tip/measured_js",
            tip,
            {"position": "output_angle", "velocity": "output_velocity", "effort": "contact_force"},
        ),
        ("/twin/tendons/measured_js", tendons, {"effort": "tension"}),
        ("/twin/tendons/distal/measured_js", tendons, {"effort": "distal_tension"}),
        ("/twin/motors/measured_js", tendons, {"position": "spool_angle", "velocity": "spool_velocity"}),
        (
            "/controller/tip/measured_js",
            compensated,
            {"position": "estimated_output_angle", "effort": "estimated_force"},
        ),
        (
            "/controller/tip/measured_js_std",
            compensated,
            {"position": "estimated_output_angle_std", "effort": "estimated_force_std"},
        ),
    )
    return [Topic(name, JOINT_STATE, joints, signals) for name, joints, signals in joint_states]


def _rig(axis: str | None) -> str:
    return "/rig/measured_cf" if axis is None else f"/rig/{axis}/measured_cf"


def read_topics(names: Names) -> frozenset[str]:
    """Return the names of the topics from which signals are read, without copies."""
    return frozenset(topic.name for topic in topics(names) if topic.copy_of is None)


TOPICS = read_topics(("",)) | read_topics(("yaw", "pitch"))
"""Names of all topics from which signals are read, of instruments with one axis or two, without copies."""

COPIES = {topic.name: topic.copy_of for axes in (("",), ("yaw", "pitch")) for topic in topics(axes) if topic.copy_of}
"""Topics from which signals are read where these are missing."""


def shape(signal: str, rows: int, axes: tuple[str, ...]) -> tuple[int, ...]:
    """Return the shape of a signal in a `Run`."""
    return (rows, *((len(axes),) if axes[1:] else ()), *((2,) if SIGNALS[signal].per_tendon else ()))


def described(signal: str) -> Signal:
    """Return unit and meaning of a signal of either kind of run, or of a component such as ``wrench.fx``."""
    name, _, part = signal.partition(".")
    about = SIGNALS[name] if name in SIGNALS else coupled_signal(name)
    if name != "wrench" or not part:
        return about
    kind, unit = ("Force", "N") if part.startswith("f") else ("Moment", "N*m")
    return Signal(unit, False, f"{kind} on the tip, {part[1:]}")


def signals_of(run: AnyRun) -> dict[str, Array]:
    """Return a run's signals by name."""
    return run.signals if isinstance(run, CoupledRun) else run.signals()


def names_of(run: AnyRun) -> Names:
    """Return what the columns of a run are named after."""
    if isinstance(run, CoupledRun):
        return CoupledNames(run.joints, run.handle_joints, run.tendons, run.compensated)
    return tuple(run.axes)


def listed(names: Names) -> str:
    """Return names in words."""
    return ", ".join(" ".join(names.texts.values()).split() if isinstance(names, CoupledNames) else names)


def run_of(names: Names, time: Array, columns: Mapping[str, Array]) -> AnyRun:
    """Return the run of signals and times (n,) from arrays of shape (n, columns), without incomplete signals."""
    rows = time.size
    if not isinstance(names, CoupledNames):
        shapes = {name: shape(name, rows, names) for name in columns}
        whole = {name: values for name, values in columns.items() if values.size == math.prod(shapes[name])}
        return Run(time, names, **{name: values.reshape(shapes[name]) for name, values in whole.items()})
    signals = dict(columns)
    wrench = [signals.pop(name, None) for name in _WRENCH.values()]
    if all(part is not None for part in wrench):
        signals["wrench"] = np.concatenate([part for part in wrench if part is not None], axis=1)
    for name in _GRIP.values():
        if name in signals:
            signals[name] = signals[name][:, 0]
    if not names.handle_joints:
        of_handle = [topic for topic in _joint_topics((), ("",), ("",), ("",)) if not topic.joints]
        signals |= {name: np.empty((rows, 0)) for topic in of_handle for name in topic.signals.values()}
    return CoupledRun(time, names.joints, names.handle_joints, names.tendons, signals, names.compensated)


def axes_of(joints: Mapping[str, tuple[str, ...]]) -> tuple[str, ...] | None:
    """Return the axes that the joints (names by topic) belong to, or None if they belong to no axis."""
    for topic in topics(("",)):
        marks = [joint.strip("_") for joint in topic.joints]
        found = [
            name.removeprefix(f"{mark}_").removesuffix(f"_{mark}")
            for name in joints.get(topic.name, ())
            for mark in marks
            if name.startswith(f"{mark}_") or name.endswith(f"_{mark}")
        ]
        if found:
            return tuple(dict.fromkeys(found))
    rigs = tuple(axis for axis in ("yaw", "pitch") if _rig(axis) in joints)
    return rigs or None


class Messages(NamedTuple):
    """The messages on a topic: the signal in each of their arrays, and the layout of their bytes."""

    topic: Topic
    signals: Mapping[str, str]
    layout: cdr.Layout

    def encode(self, stamps: NDArray[np.int64], columns: Mapping[str, Array]) -> bytes:
        """Return the messages with these stamps (n,), in ns, of :func:`flat_columns`, joined."""
        numbers = {field: columns[signal][:, self.topic.columns] for field, signal in self.signals.items()}
        return self.layout.encode(stamps, numbers)


def messages_of(names: Names, carried: Collection[str]) -> list[Messages]:
    """Return the messages that carry signals by name, ``time`` included."""
    found = []
    for topic in topics(names):
        signals = {field: signal for field, signal in topic.signals.items() if signal in carried}
        if signals:
            found.append(Messages(topic, signals, _layout(topic, signals)))
    return found


def flat_columns(run: AnyRun) -> dict[str, Array]:
    """Return a run's signals and time by name, each of shape (n, columns): by axis, then tendon.

    The components of a coupled run's wrench are signals of their own.
    """
    if not isinstance(run, CoupledRun):
        return {name: values.reshape(len(run), -1) for name, values in ({"time": run.time} | run.signals()).items()}
    columns = {"time": run.time} | run.signals
    if "wrench" in columns:
        wrench = columns.pop("wrench")
        columns |= {f"wrench.{part}": wrench[:, n] for n, part in enumerate(run.columns("wrench"))}
    return {name: values if values.ndim == 2 else values[:, np.newaxis] for name, values in columns.items()}


def event_message(time: float, content: Mapping[str, Any]) -> bytes:
    """Return the message of an event at a time (s): JSON in a String.

    Raises
    ------
    TypeError, ValueError
        JSON cannot express the content.
    """
    return cdr.text(json.dumps({**content, "time": time}))


def _layout(topic: Topic, signals: Mapping[str, str]) -> cdr.Layout:
    if topic.type == JOINT_STATE:
        return cdr.joint_state(topic.joints, dict.fromkeys(signals, len(topic.joints)), topic.frame)
    return cdr.wrench(topic.frame) if topic.type == WRENCH else cdr.number()
