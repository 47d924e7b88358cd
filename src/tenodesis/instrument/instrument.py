"""The instrument from which everything is computed: joints and tendons, in either form that a file may have."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, BaseModel, Field

from tenodesis import _core
from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.instrument.conditions import Conditions
from tenodesis.instrument.devices import Devices
from tenodesis.instrument.hardware import Control, Drives, Friction, Geometry, Sensors
from tenodesis.instrument.joints import MECHANISMS, SIGNS, Crossing, Joint, Tendon
from tenodesis.instrument.tension import TensionSensor, tension_sensor
from tenodesis.instrument.ties import Tie, own_stiffness, ties
from tenodesis.toml import FileTable, validated
from tenodesis.units import Force, Length, Modulus, PositiveForce, Quantity, Stiffness, quantity_of

if TYPE_CHECKING:
    from tenodesis.instrument.any_form import AnyForm
else:
    AnyForm = object

Array = NDArray[np.float64]

ENTRIES = {"joints": "joint", "tendons": "tendon"}
"""What an entry of a list of tables is called in messages."""


def _printable(name: str) -> str:
    if not (1 <= len(name) <= 60 and name.isprintable()):
        raise ArgumentError("it must be 1 to 60 printable characters")
    return name


Name = Annotated[str, AfterValidator(_printable)]
"""Name of an instrument or a protocol."""


def arm_of(crossing: Crossing, joint: Joint) -> float:
    """Return the length by which a joint draws a tendon at a crossing, per unit of its coordinate, m."""
    radius = joint.radius if crossing.radius is None else crossing.radius
    return SIGNS[crossing.side or "middle"] * _core.joint_excursion(MECHANISMS[joint.mechanism], radius)


class Instrument(FileTable, AnyForm):
    """An instrument in SI units and radians; use :func:`load`, then :meth:`replace` for variants of it.

    A file describes it by its joints and tendons, or by a short form for joints in one plane or two, which
    :attr:`expanded` writes out.

    Raises
    ------
    InstrumentError
        By `load` and `replace`, when a value is missing, unknown or not allowed; by what only the short form has.
    """

    name: Name = Field(description="Name of the instrument in figures and tables")
    description: str = Field(default="", max_length=200, description="One line about the instrument")
    stem_diameter: Length | None = Field(default=None, description="Outer diameter of the stem")
    tendon_diameter: Length | None = Field(default=None, description="Diameter of a tendon's load-bearing section")
    tendon_modulus: Modulus | None = Field(default=None, description="Young's modulus of a tendon")
    tendon_length: Length | None = Field(default=None, description="Length of a tendon")
    given_stiffness: Stiffness | None = Field(
        default=None, alias="tendon_stiffness", description="Stiffness of a tendon; by default E A / L"
    )
    pretension: Force = Field(description="Tension of every tendon at rest")
    breaking_load: PositiveForce | None = Field(default=None, description="Tension at which a tendon breaks")
    conditions: Conditions = Conditions()
    friction: Friction = Friction()
    drives: Drives = Drives()
    sensors: Sensors = Sensors()
    control: Control = Control()
    geometry: Geometry = Geometry()
    devices: Devices = Devices()
    sources: Mapping[str, str] = Field(default={}, description="Source of each value, by key")

    def to_toml(self) -> str:
        """Return the text of a file of this instrument, from which :func:`parse` reads it back to the last bit."""
        from tenodesis.instrument.text import to_toml  # noqa: PLC0415 - it needs this class

        return to_toml(self)

    @property
    def tip_joints(self) -> tuple[Joint, ...]:
        """Joints at the tip, from the stem outward."""
        return tuple(joint for joint in self.joints if joint.place == "tip")

    @property
    def handle_joints(self) -> tuple[Joint, ...]:
        """Joints at the handle, from the stem outward."""
        return tuple(joint for joint in self.joints if joint.place == "handle")

    @property
    def arc_places(self) -> dict[str, list[int]]:
        """Places among the tip's joints of every joint by its name, of a backbone in arcs of all of these."""
        found: dict[str, list[int]] = {}
        for i, joint in enumerate(self.tip_joints):
            found.setdefault(joint.bend, []).append(i)
        return found

    @property
    def bends(self) -> dict[str, list[int]]:
        """Places among the tip's joints of what bends by itself, by name: joints not tied, arcs of a backbone."""
        joints = self.tip_joints
        return {
            name: places
            for name, places in self.arc_places.items()
            if joints[places[0]].tied_to is None and not joints[places[0]].is_twist
        }

    def bent(self, angles: ArrayLike) -> Array:
        """Return the angles of the tip's joints, (joints,), at those of what bends, (bends,).

        Arcs of a backbone bend alike, and joints that are tied turn with the others.
        """
        found = np.zeros(len(self.tip_joints))
        for angle, arcs in zip(np.asarray(angles, float), self.bends.values(), strict=True):
            found[arcs] = angle / len(arcs)
        for i, tie in enumerate(self.ties):
            if tie.is_rigid:
                found[i] = tie.ratio * found[tie.to]
        return found

    @property
    def bend_limits(self) -> Array:
        """Ends of the working ranges of what bends, (bends, 2), rad."""
        limits = np.array([joint.limits for joint in self.tip_joints])
        return np.array([limits[arcs].sum(axis=0) for arcs in self.bends.values()])

    @property
    def bend_ends(self) -> Array:
        """The ends to which a jaw opens and others bend farther, (bends,), rad; of equal ones the positive."""
        low, high = self.bend_limits.T
        opens = self.grip_arms[[arcs[0] for arcs in self.bends.values()]]
        return np.asarray(np.where(np.where(opens == 0, high >= -low, opens > 0), high, low))

    @property
    def parents(self) -> tuple[int, ...]:
        """Place among the tip's joints of the one that each stands on; -1 for the stem."""
        names = [joint.name for joint in self.tip_joints]
        return tuple(
            i - 1 if joint.on is None else (-1 if joint.on == "stem" else names.index(joint.on))
            for i, joint in enumerate(self.tip_joints)
        )

    @property
    def ends(self) -> tuple[int, ...]:
        """Places of the joints that no other stands on: the end-effector or the jaws."""
        return tuple(i for i in range(len(self.tip_joints)) if i not in self.parents)

    @property
    def bearing(self) -> tuple[int, ...]:
        """Places of the joints among the tip's at whose ends the wrench acts: those with an end_effector_length."""
        return tuple(i for i, joint in enumerate(self.tip_joints) if joint.end_effector_length is not None)

    @property
    def jaws(self) -> tuple[int, ...]:
        """Places of the jaws among the tip's joints; empty if nothing grips."""
        names = [joint.name for joint in self.tip_joints]
        return () if self.grip is None else tuple(names.index(jaw) for jaw in self.grip.jaws)

    @property
    def grip_arms(self) -> Array:
        """Lengths by which the jaws open per angle of the tip's joints, (joints,), m; the first of them to the +."""
        arms = np.zeros(len(self.tip_joints))
        for sign, i in zip((1.0, -1.0), self.jaws, strict=False):
            own = self.grip.length if self.grip is not None else None
            arms[i] = sign * (own or self.tip_joints[i].end_effector_length or 0.0)
        return arms

    def tendon_arms(self, place: Literal["tip", "handle"]) -> Array:
        """Return the arms of the tendons at one end, (tendons, joints), m per unit of the joints' coordinates."""
        joints = self.tip_joints if place == "tip" else self.handle_joints
        index = {joint.name: i for i, joint in enumerate(joints)}
        arms = np.zeros((len(self.tendons), len(joints)))
        for row, tendon in zip(arms, self.tendons, strict=True):
            for crossing in tendon.route:
                if crossing.joint in index:
                    row[index[crossing.joint]] += arm_of(crossing, joints[index[crossing.joint]])
        return arms

    @property
    def springs(self) -> Array:
        """Moments of springs and ties by the angles of the tip's joints, (joints, joints), N m/rad."""
        matrix = np.diag([own_stiffness(joint) for joint in self.tip_joints])
        for i, tie in enumerate(self.ties):
            if tie.to >= 0:
                apart = np.zeros(len(matrix))
                apart[[i, tie.to]] = 1.0, -tie.ratio
                matrix += tie.stiffness * np.outer(apart, apart)
        return matrix

    @cached_property
    def ties(self) -> list[Tie]:
        """What ties every joint of the tip to one before it."""
        held = self.stiffnesses @ self.tendon_arms("tip") ** 2
        held += [own_stiffness(joint) for joint in self.tip_joints]
        return ties(self.tip_joints, held)

    @cached_property
    def stiffnesses(self) -> Array:
        """Stiffness of every tendon, (tendons,), N/m, as given or E A / L."""
        return np.array([self.stiffness_of(tendon) for tendon in self.tendons])

    @cached_property
    def pretensions(self) -> Array:
        """Tension of every tendon at rest, (tendons,), N."""
        own = (self.pretension if tendon.pretension is None else tendon.pretension for tendon in self.tendons)
        return np.array(list(own))

    def stretches(self, tensions: ArrayLike) -> Array:
        """Return the lengths by which tendons at tensions, (..., tendons), N, are stretched more than at rest, m."""
        return self._by_tendon(self.core.stretches, tensions)

    def tensions_at(self, stretches: ArrayLike) -> Array:
        """Return the inverse of :meth:`stretches`, N; negative where a tendon would have to push."""
        return self._by_tendon(self.core.tensions, stretches)

    def _by_tendon(self, work: Callable[[Array, Array], None], given: ArrayLike) -> Array:
        rows = np.ascontiguousarray(given, float)
        out = np.empty_like(rows)
        work(rows.reshape(-1, len(self.tendons)), out.reshape(-1, len(self.tendons)))
        return out

    @cached_property
    def own_drives(self) -> Drives:
        """The drives, with the spools that the instrument has."""
        return self.drives

    @cached_property
    def tension_sensors(self) -> tuple[TensionSensor, ...]:
        """What measures the tension of every tendon."""
        return tuple(tension_sensor(self.own_drives, self.sensors, float(tension)) for tension in self.pretensions)

    @property
    def joint_rows(self) -> Array:
        """Numbers of the tip's joints as the core takes them: axis, offset, chord, length, springs, tie, load, grip."""
        joints, bearing = self.tip_joints, self.bearing
        numbers = np.zeros((len(joints), 15))
        for i, joint in enumerate(joints):
            length = joint.end_effector_length or 0.0
            share = 1 / len(bearing) if i in bearing else 0.0
            arm = self.grip_arms[i]
            spring = (own_stiffness(joint), joint.cubic_stiffness, *self.ties[i])
            chord = 1.0 if joint.within else joint.chord
            numbers[i] = (
                *joint.axis_vector,
                joint.offset,
                chord,
                length,
                *spring,
                share,
                arm,
                joint.within is not None,
            )
        return numbers

    @cached_property
    def core(self) -> _core.TendonChain:
        """The instrument in the core's form."""
        return _core.TendonChain(
            [MECHANISMS[joint.mechanism] for joint in self.tip_joints],
            list(self.parents),
            self.joint_rows,
            self.tendon_arms("tip"),
            np.column_stack([self.stiffnesses, self.pretensions]),
            [int(tendon.start == "spool") for tendon in self.tendons],
            [MECHANISMS[joint.mechanism] for joint in self.handle_joints],
            np.ascontiguousarray(self.tendon_arms("handle")),
            self.growth_rows,
        )

    @property
    def growth_rows(self) -> Array:
        """Tension (N) and stiffness over that at rest of tendons' tables, (tendons, entries, 2), or no rows."""
        tables = [tendon.stiffness_by_tension for tendon in self.tendons]
        longest = max((len(table.tension) for table in tables if table is not None), default=0)
        rows = np.full((len(tables) if longest else 0, longest, 2), np.nan)
        for row, table, at_rest in zip(rows, tables, self.stiffnesses, strict=False):
            if table is not None:
                row[: len(table.tension)] = np.column_stack([table.tension, np.divide(table.stiffness, at_rest)])
        return rows

    def __eq__(self, other: object) -> bool:
        # What is computed from the fields and kept may hold arrays, which have no single truth.
        return type(self) is type(other) and all(
            getattr(self, key) == getattr(other, key) for key in type(self).model_fields
        )

    def __hash__(self) -> int:
        return hash((self.name, self.pretension))

    @cached_property
    def closed_form(self) -> _core.Spec | None:
        """The core's form of one joint between a matched pair of tendons; None for any other instrument."""
        if len(self.tip_joints) != 1 or len(self.handle_joints) != 1:
            return None
        handle = self.handle_joints[0]
        return self.core.closed_form(handle.end_effector_length or math.nan, handle.range)

    def quantities(self) -> Iterator[tuple[str, float, Quantity]]:
        """Yield key, value in SI and kind of quantity of every dimension given."""
        for name, field in type(self).model_fields.items():
            quantity = quantity_of(field)
            value = getattr(self, name)
            if quantity is not None and value is not None:
                yield field.alias or name, value, quantity

    def __getstate__(self) -> dict[Any, Any]:
        """Return what is kept of it: its values, not what was computed from them."""
        state = super().__getstate__()
        fields = type(self).model_fields
        return state | {"__dict__": {name: value for name, value in state["__dict__"].items() if name in fields}}

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        copied = type(self).__new__(type(self))
        copied.__setstate__(deepcopy(self.__getstate__(), memo))
        return copied

    def replace(self, **changes: Any) -> Self:
        """Return this instrument with some values changed, by key; lists of tables as lists of dictionaries.

        Values are in SI units or text with a unit; None leaves a key out again. A key within a table is written with a
        dot: ``**{"friction.vertex_coefficient": 0.2}``; of joints and tendons after their name, and of a route after
        its joint's: ``joints.pitch.radius``, ``tendons.a.pitch.radius``. Raises InstrumentError if a key is unknown or
        a value is not allowed.
        """
        return validated(type(self), self.with_values(changes), InstrumentError, entries=ENTRIES)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy by :meth:`replace`, so that its changes are checked and passed to the core."""
        return self.replace(**(update or {}))

    def as_given(self, name: str) -> Any:
        """Return the value of a field as its file has it."""
        return getattr(self, name)

    def with_values(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values of this instrument by key, with changes; None removes a key."""
        fields = type(self).model_fields
        values = {fields[key].alias or key: self.as_given(key) for key in self.model_fields_set}
        for key, value in changes.items():
            table, _, inner = key.partition(".")
            held = values.get(table, getattr(self, table, None)) if inner else None
            held = {} if held is None and table in fields else held
            if inner and isinstance(held, BaseModel | dict):
                own = dict(held) if isinstance(held, dict) else held.model_dump(exclude_unset=True)
                values[table] = {name: item for name, item in (own | {inner: value}).items() if item is not None}
            elif inner and isinstance(held, tuple | list) and table in ENTRIES:
                values[table] = _with_entry(held, key, inner.split("."), value)
            else:
                values[key] = value
        return {key: value for key, value in values.items() if value is not None}

    def stiffness_of(self, tendon: Tendon) -> float:
        """Return the stiffness of a tendon at rest, N/m, as given or E A / L; raises ArgumentError if neither is."""
        if tendon.stiffness_by_tension is not None:
            return tendon.stiffness_by_tension.at(self.pretension if tendon.pretension is None else tendon.pretension)
        if tendon.stiffness is not None:
            return tendon.stiffness
        if self.given_stiffness is not None and tendon.length is None:
            return self.given_stiffness
        length = self.tendon_length if tendon.length is None else tendon.length
        if self.tendon_modulus is None or self.tendon_diameter is None or length is None:
            raise ArgumentError(
                f"tendon {tendon.name} has no stiffness; give tendon_stiffness, or tendon_diameter, tendon_modulus and "
                "tendon_length",
                key="tendon_stiffness",
            )
        return self.tendon_modulus * math.pi / 4 * self.tendon_diameter**2 / length


def _with_entry(entries: Sequence[Any], key: str, path: Sequence[str], value: Any) -> list[Any]:
    """Return entries of a list, of which that with a name, or that crosses a joint, has another value; None: none."""
    name, *inner = path
    tables = [one if isinstance(one, dict) else one.model_dump(exclude_unset=True) for one in entries]
    names = [str(one.get("name", one.get("joint"))) for one in tables]
    if name not in names or not inner:
        allowed = f"{key.removesuffix('.'.join(path))}NAME.KEY, with NAME one of {', '.join(names)}"
        raise InstrumentError(f"{key} is not a known key; it must be {allowed}.", key=key, value=value, allowed=allowed)
    at = names.index(name)
    if inner[1:]:
        tables[at] = tables[at] | {"route": _with_entry(tables[at].get("route", ()), key, inner, value)}
    else:
        tables[at] = {one: item for one, item in (tables[at] | {inner[0]: value}).items() if item is not None}
    return tables
