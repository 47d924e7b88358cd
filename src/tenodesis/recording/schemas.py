"""The topics of a recording, and the messages that carry the signals of a run on them."""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis.recording import cdr
from tenodesis.run import COMPONENTS, HELD, SIGNALS, TENDONS, TISSUE, Array, Names, Run, Signal

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
FLOAT64 = "std_msgs/msg/Float64"
STRING = "std_msgs/msg/String"

METADATA = "tenodesis"
"""Name of the metadata record."""

SEEN = "tenodesis.rows"
"""Name of the metadata record at the end, which says in JSON what the rows hold."""

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
"""Component of the wrench in each field of the message."""
NUMBERS: Mapping[str, tuple[str, ...]] = {
    JOINT_STATE: ("position", "velocity", "effort"),
    WRENCH: tuple(_WRENCH),
    FLOAT64: ("data",),
}
"""Numbers of a message by its type; of joints each is an array."""
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


_TIP = "tip_"
"""What joints of the tip begin with in recordings of planar instruments by earlier versions."""


class Topic(NamedTuple):
    """A topic: its message type, its joints, and the signal in each of the message's arrays.

    Of a signal's columns the topic carries `columns`.
    """

    name: str
    type: str
    joints: tuple[str, ...]
    signals: Mapping[str, str]
    columns: slice = slice(None)
    frame: str = ""
    copy_of: str | None = None
    """Topic that has its signals, too, from which they are read if there is one."""
    before: str = ""
    """Name of the topic in recordings of instruments with shared tendons by earlier versions."""


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


def names_in(metadata: Mapping[str, str], joints: Mapping[str, tuple[str, ...]]) -> Names | None:
    """Return the names in a recording's metadata and joints (by topic), or None if there are none.

    Names in messages count first: checksums protect them.
    """
    if Names._fields[0] in metadata:
        found = {group: tuple(metadata.get(group, "").split()) for group in Names._fields}
        found |= {topic.joints[0]: joints[topic.name] for topic in _JOINT_TOPICS if topic.name in joints}
        return Names(**found)
    axes = axes_of(joints) or tuple(metadata.get("axes", "").split())
    return Names.paired(axes) if axes else None


def texts_of(names: Names) -> dict[str, str]:
    """Return names as metadata."""
    return {group: " ".join(own) for group, own in names._asdict().items()}


def topics(names: Names) -> tuple[Topic, ...]:
    """Return every topic of an instrument with these joints and tendons."""
    joints = names.joints
    forces = {"force.x": "force", "force.z": "radial_force"}
    return (
        Topic(TIME, FLOAT64, (), {"data": "time"}),
        *(topic for topic in _joint_topics(names) if topic.joints),
        *(
            Topic(_of_one("rig", joint, joints, "measured_cf"), WRENCH, (), forces, slice(i, i + 1), f"{_TIP}{joint}")
            for i, joint in enumerate(joints)
        ),
        Topic("/rig/wrench", WRENCH, (), _WRENCH, frame="tip", before="/rig/measured_cf"),
        *(Topic(topic, FLOAT64, (), {"data": signal}) for topic, signal in _GRIP.items()),
        *(Topic(f"/twin/{signal}", FLOAT64, (), {"data": signal}) for signal in HELD),
        *(
            Topic(
                _of_one("controller", joint, names.compensated, "measured_cf"),
                WRENCH,
                (),
                {"force.x": "estimated_force"},
                slice(i, i + 1),
                f"{_TIP}{joint}",
                copy_of="/controller/tip/measured_js",
            )
            for i, joint in enumerate(names.compensated)
        ),
        *_number_topics("controller", _CONTROL_NUMBERS, names.compensated),
        *_number_topics("twin", TISSUE, joints),
    )


def _number_topics(origin: str, signals: Sequence[str], joints: tuple[str, ...]) -> list[Topic]:
    """Return a topic for each signal of each joint."""
    return [
        Topic(
            _of_one(origin, joint, joints, signal),
            FLOAT64,
            (),
            {"data": signal},
            slice(i, i + 1),
            before=f"/{origin}/{joint}/{signal}",
        )
        for signal in signals
        for i, joint in enumerate(joints)
    ]


def _of_one(origin: str, joint: str, joints: tuple[str, ...], name: str) -> str:
    """Return the name of a topic of one joint, which it has if there are several."""
    return f"/{origin}/{joint}/{name}" if joints[1:] else f"/{origin}/{name}"


def _joint_topics(names: Names) -> list[Topic]:
    tip, handle, tendons, compensated = names
    joint_states = (
        ("/handle/measured_js", handle, {"position": "measured_handle_angle"}),
        ("/handle/setpoint_js", handle, {"position": "commanded_handle_angle"}),
        ("/motors/measured_js", tendons, {"position": "measured_spool_angle"}),
        ("/motors/setpoint_js", tendons, {"velocity": "commanded_spool_velocity"}),
        ("/tendons/setpoint_js", tendons, {"effort": "commanded_spool_tension"}),
        ("/motors/current", tendons, {"effort": "measured_current"}),
        ("/tendons/measured_js", tendons, {"effort": "measured_tension"}),
        ("/tip/setpoint_js", tip, {"position": "commanded_output_angle"}),
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


_JOINT_TOPICS = _joint_topics(Names(*((group,) for group in Names._fields)))
"""The topics with joints, whose joints are here what they are named after."""

JOINT_TOPICS = frozenset(topic.name for topic in _JOINT_TOPICS)


def read_topics(names: Names) -> frozenset[str]:
    """Return the names of the topics from which signals are read, without copies."""
    found = [topic for topic in topics(names) if topic.copy_of is None]
    return frozenset(name for topic in found for name in (topic.name, topic.before) if name)


_USUAL = (Names.paired(["yaw"]), Names.paired(["yaw", "pitch"]))
TOPICS = frozenset[str]().union(*(read_topics(names) for names in _USUAL))
"""Names of all topics from which signals are read where no metadata name the joints, without copies."""

COPIES = {topic.name: topic.copy_of for names in _USUAL for topic in topics(names) if topic.copy_of}
"""Topics from which signals are read where these are missing."""


def places(joints: Sequence[str], found: Sequence[str]) -> list[int] | None:
    """Return where joints are among those that a message has; None unless all of them are there."""
    plain = [one if one in joints else one.removeprefix(_TIP) for one in found]
    return [plain.index(joint) for joint in joints] if set(joints) <= set(plain) else None


def described(signal: str) -> Signal:
    """Return unit and meaning of a signal, or of a component such as ``wrench.fx``."""
    name, _, part = signal.partition(".")
    if name != "wrench" or not part:
        return SIGNALS[name]
    kind, unit = ("Force", "N") if part.startswith("f") else ("Moment", "N*m")
    return Signal(unit, "run", f"{kind} on the tip, {part[1:]}")


def run_of(names: Names, time: Array, columns: Mapping[str, Array]) -> Run:
    """Return the run of signals and times (n,) from arrays of shape (n, columns), without incomplete signals."""
    rows = time.size
    signals = dict(columns)
    wrench = [signals.pop(name, None) for name in _WRENCH.values()]
    if all(part is not None for part in wrench):
        signals["wrench"] = np.concatenate([part for part in wrench if part is not None], axis=1)
    if not names.handle_joints:
        signals |= {name: np.empty((rows, 0)) for name, one in SIGNALS.items() if one.of == "handle_joints"}
    shapes = {name: names.shape(name, rows) for name in signals}
    whole: dict[str, Any] = {
        name: values.reshape(shapes[name]) for name, values in signals.items() if values.size == math.prod(shapes[name])
    }
    return Run(time, *names, **whole)


def axes_of(joints: Mapping[str, tuple[str, ...]]) -> tuple[str, ...] | None:
    """Return the axes that the joints (names by topic) belong to, or None if they belong to no axis."""
    for topic in _JOINT_TOPICS:
        found = [axis for name in joints.get(topic.name, ()) if (axis := _axis_of(name))]
        if found:
            return tuple(dict.fromkeys(found))
    rigs = tuple(axis for axis in ("yaw", "pitch") if f"/rig/{axis}/measured_cf" in joints)
    return rigs or None


def _axis_of(joint: str) -> str:
    """Return the axis in the name of a joint or tendon; empty if it is not named after one."""
    for mark in ("handle_", _TIP):
        if joint.startswith(mark):
            return joint.removeprefix(mark)
    side = next((side for side in TENDONS if joint.endswith(f"_{side}")), None)
    return "" if side is None else joint.removesuffix(f"_{side}")


class TopicMessages(NamedTuple):
    """The messages on a topic: the signal in each of their arrays, and the layout of their bytes."""

    topic: Topic
    signals: Mapping[str, str]
    layout: cdr.MessageLayout

    def encode(self, stamps: NDArray[np.int64], columns: Mapping[str, Array]) -> bytes:
        """Return the messages with these stamps (n,), in ns, of :func:`flat_columns`, joined."""
        numbers = {field: columns[signal][:, self.topic.columns] for field, signal in self.signals.items()}
        return self.layout.encode(stamps, numbers)


def messages_of(names: Names, carried: Collection[str]) -> list[TopicMessages]:
    """Return the messages that carry signals by name, ``time`` included."""
    found = []
    for topic in topics(names):
        signals = {field: signal for field, signal in topic.signals.items() if signal in carried}
        if signals:
            counts = dict.fromkeys(signals, len(topic.joints))
            found.append(TopicMessages(topic, signals, layout(topic.type, topic.joints, counts, topic.frame)))
    return found


def flat_columns(run: Run) -> dict[str, Array]:
    """Return a run's signals and time by name, each of shape (n, columns); components of the wrench singly."""
    columns = {"time": run.time[:, np.newaxis]} | {name: run.by_column(name) for name in run.signals()}
    wrench = columns.pop("wrench", None)
    parts = {} if wrench is None else {f"wrench.{part}": wrench[:, [n]] for n, part in enumerate(COMPONENTS)}
    return columns | parts


def event_message(time: float, content: Mapping[str, Any]) -> bytes:
    """Return the message of an event at a time (s): JSON in a String.

    Raises
    ------
    TypeError, ValueError
        JSON cannot express the content.
    """
    return cdr.text(json.dumps({**content, "time": time}))


def layout(kind: str, joints: Sequence[str], counts: Mapping[str, int], frame: str) -> cdr.MessageLayout:
    """Return the layout of messages about joints, with so many numbers in each of their arrays, none if left out."""
    found = cdr.MessageLayout()
    if kind != FLOAT64:
        found.header(frame)
    if kind == JOINT_STATE:
        found.strings(joints)
    for name in NUMBERS[kind]:
        found.sequence(name, counts.get(name, 0)) if kind == JOINT_STATE else found.numbers(name)
    return found
