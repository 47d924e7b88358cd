"""An instrument as its file lists it: joints and tendons that may cross several of them."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from tenodesis import _core, notebook
from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.instrument.backbones import cut
from tenodesis.instrument.hardware import Drives, Friction
from tenodesis.instrument.instrument import Instrument
from tenodesis.instrument.joints import Grip, Joint, LinkDynamics, Tendon
from tenodesis.instrument.short_form import ShortForm
from tenodesis.units import Length

_BUILD = "build it with -C cmake.define.TENODESIS_MOST_{}={} for more"


class RouteError(ValueError):
    """What is wrong with the routes of an instrument, and where: a tendon, joints, or both.

    Parameters
    ----------
    sentence
        What is wrong.
    inst
        The instrument, whose tables are valid one by one.
    tendon, joints
        Their names, empty if it is not about one.
    """

    def __init__(self, sentence: str, inst: "FullForm", *, tendon: str = "", joints: Sequence[str] = ()) -> None:
        super().__init__(sentence)
        self.inst, self.tendon, self.joints = inst, tendon, tuple(joints)


class FullForm(Instrument):
    """An instrument whose file lists joints and tendons."""

    stem_length: Length | None = Field(default=None, description="Of the stem, for drawings and models")
    spool_radius: Length | None = Field(default=None, description="Radius of the motors' spools")
    joints: tuple[Joint, ...] = Field(min_length=1, description="From the stem outward at either end")
    tendons: tuple[Tendon, ...] = Field(min_length=1, description="All tendons")
    grip: Grip | None = Field(default=None, description="Jaws that grip")
    dynamics: LinkDynamics = LinkDynamics()
    _given: dict[str, Any] = PrivateAttr()
    """Joints and tendons before backbones were cut into arcs."""

    @property
    def short_form(self) -> None:
        """The instrument in the short form: none."""
        return None

    @property
    def expanded(self) -> Self:
        """The instrument as joints and tendons: itself."""
        return self

    @cached_property
    def own_drives(self) -> Drives:
        """The drives, with the spools that the instrument has."""
        own = {} if self.spool_radius is None else {"spool_radius": self.spool_radius}
        return self.drives.model_copy(update=own)

    @property
    def as_chain(self) -> Self:
        """The joints and tendons that statics act on: all of them."""
        return self

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name[0] != "_" and not _has(type(self), name) and any(_has(kind, name) for kind in _kinds(ShortForm)):
                raise self.not_short()
            return super().__getattr__(name)

    def not_short(self) -> InstrumentError:
        """Return the error for what takes the short form."""
        return InstrumentError(
            f"{self.name} lists joints and tendons; it must be a planar instrument, with a joint_type.",
            key="joint_type",
            value=None,
            allowed="a planar instrument",
        )

    def __repr__(self) -> str:
        joints = ", ".join(joint.name for joint in self.tip_joints)
        return f"<{type(self).__name__} {self.name!r}: {joints}; {len(self.tendons)} tendons>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return a table for notebooks: the arms of the tendons about the tip's joints."""
        arms = 1e3 * self.tendon_arms("tip")
        rows = [(tendon.name, *(f"{arm:.4g}" for arm in row)) for tendon, row in zip(self.tendons, arms, strict=True)]
        return notebook.table(f"{self.name}: arms in mm", ("tendon", *(j.name for j in self.tip_joints)), rows)

    @model_validator(mode="after")
    def _coherent(self, info: ValidationInfo) -> Self:
        _check_distinct("joints", [joint.name for joint in self.joints])
        for tendon in self.tendons:
            _check_route(self, tendon)
        self._given = {"joints": self.joints, "tendons": self.tendons}
        # The model is frozen for everyone else.
        self.__dict__["joints"], self.__dict__["tendons"] = cut(self.joints, self.tendons)
        _check_distinct("joints", [joint.name for joint in self.joints])
        self._check_joints()
        for tendon in self.tendons:
            self.stiffness_of(tendon)
        _check_distinct("tendons", [tendon.name for tendon in self.tendons])
        self._check_held()
        self.tension_sensors  # noqa: B018 - refuses currents that cannot measure them
        self.devices.check_tensions(self.sensors.kind)
        # A short form may have friction that no file of joints and tendons has.
        if not (info.context and info.context.get("expanded")):
            self._check_friction()
        return self

    def as_given(self, name: str) -> Any:
        """Return the value of a field as its file has it: backbones are not cut into arcs."""
        return self._given.get(name, getattr(self, name))

    def _check_joints(self) -> None:
        tips, handles = self.tip_joints, self.handle_joints
        for key, what, count, most in (
            ("joints", "joints has {} at the tip", len(tips), _core.MOST_JOINTS),
            ("tendons", "tendons has {}", len(self.tendons), _core.MOST_TENDONS),
        ):
            if not 1 <= count <= most:
                more = f" in this build of the core; {_BUILD.format(key.upper(), count)}" if count > most else ""
                problem = f"{what.format(count)}; there must be 1 to {most}{more}"
                raise ArgumentError(problem, key=key, value=count, allowed=f"1 to {most}")
        if len(handles) > len(tips):
            raise ArgumentError(
                f"joints has {len(handles)} at the handle; there must be at most {len(tips)}, as at the tip",
                key="joints",
            )
        before: list[str] = ["stem"]
        for joint in tips:
            if joint.on is not None and joint.on not in before:
                raise ArgumentError(
                    f"joint {joint.name}: on = {joint.on!r}; it must be one of {', '.join(before)}",
                    key="on",
                    value=joint.on,
                )
            before.append(joint.name)
        for place, joint in enumerate((*tips, *handles)):
            _check_tie(joint, [other.name for other in tips[:place] if not other.arc] if place < len(tips) else [])
        held = self.grip.jaws if self.grip is not None and self.grip.length is not None and self.bearing else ()
        for i in self.ends:
            # A block that a rope carries stands on the stem and bears nothing.
            is_block = tips[i].on == "stem" and bool(self.bearing)
            if tips[i].end_effector_length is None and tips[i].name not in held and not is_block:
                raise ArgumentError(
                    f"joint {tips[i].name} is the last; its end_effector_length must be given",
                    key="end_effector_length",
                )
        if self.grip is not None:
            names = [tips[i].name for i in self.ends]
            wrong = [jaw for jaw in self.grip.jaws if jaw not in names]
            if wrong:
                raise ArgumentError(
                    f"grip.jaws names {wrong[0]!r}; it must name the last joints: {', '.join(names)}",
                    key="grip.jaws",
                    value=wrong[0],
                )

    def _check_friction(self) -> None:
        friction = self.friction
        for key in ("base_wrap", "passing_coefficient"):
            given, default = getattr(friction, key), Friction.model_fields[key].default
            if given != default:
                instead = "; give base_wrap or guide_wrap in a tendon's route" if key == "base_wrap" else ""
                raise ArgumentError(
                    f"friction.{key} is {given:g}, which only the short form has{instead}",
                    key=f"friction.{key}",
                    value=given,
                )
        if self.spool_radius is not None and "spool_radius" in self.drives.model_fields_set:
            raise ArgumentError(
                "spool_radius and drives.spool_radius are both given; give one of them", key="spool_radius"
            )

    def _check_held(self) -> None:
        """Refuse joints that nothing holds, and tendons that leave a motion of several joints free."""
        arms = self.tendon_arms("tip")
        sprung = np.array([joint.is_sprung for joint in self.tip_joints])
        for joint, column, spring in zip(self.tip_joints, arms.T, sprung, strict=True):
            missing = [side for side, pulls in (("agonist", column > 0), ("antagonist", column < 0)) if not pulls.any()]
            if missing and not spring and joint.tied_to is None:
                raise RouteError(
                    f"joint {joint.name} has no {' and no '.join(missing)}: no tendon crosses it on that side; give it "
                    "one, or a spring by its stiffness",
                    self,
                    joints=[joint.name],
                )
        scale = np.abs(arms).max(axis=0)
        tied = [
            np.eye(len(self.tip_joints))[i] - tie.ratio * np.eye(len(self.tip_joints))[tie.to]
            for i, tie in enumerate(self.ties)
            if tie.is_rigid
        ]
        held = np.vstack([arms / np.where(scale > 0, scale, 1.0), np.diag(sprung.astype(float)), *tied])
        if np.linalg.matrix_rank(held) < len(self.tip_joints):
            names = [joint.name for joint in self.tip_joints]
            raise RouteError(
                f"the coupling matrix of {', '.join(names)} is singular: a motion of several joints draws no tendon; "
                "it must have full rank",
                self,
                joints=names,
            )


def _has(kind: type[Instrument], name: str) -> bool:
    return name in kind.model_fields or hasattr(kind, name)


def _kinds(of: type[ShortForm]) -> Iterator[type[ShortForm]]:
    """Yield a class and all that derive from it."""
    yield of
    for kind in of.__subclasses__():
        yield from _kinds(kind)


def _check_distinct(key: str, names: Sequence[str]) -> None:
    double = next((name for name in names if names.count(name) > 1), None)
    if double is not None:
        raise ArgumentError(f"{key} has {double} twice; names must differ", key=key, value=double)


def _check_tie(joint: Joint, before: Sequence[str]) -> None:
    if joint.tied_to is None:
        return
    if joint.tied_to not in before:
        allowed = ", ".join(before) or "none is, so it must be left out"
        problem = f"joint {joint.name}: tied_to = {joint.tied_to!r}; it must be one before it: {allowed}"
        raise ArgumentError(problem, key="tied_to", value=joint.tied_to)
    in_several = joint.arc_count > 1
    if in_several or joint.within is not None or not joint.tie_ratio:
        problem = "has several arcs" if in_several else "has a tie_ratio of 0"
        raise ArgumentError(
            f"joint {joint.name} is tied to {joint.tied_to} and {problem}; give it without that", key="tied_to"
        )


def _check_route(inst: FullForm, tendon: Tendon) -> None:
    known, sides = {joint.name: joint for joint in inst.joints}, dict[str, str | None]()
    for crossing in tendon.route:
        name = crossing.joint

        def wrong(sentence: str, name: str = name) -> RouteError:
            return RouteError(f"tendon {tendon.name}{sentence}", inst, tendon=tendon.name, joints=[name])

        if name not in known:
            raise wrong(f": joint = {name!r}; it must be one of {', '.join(known)}")
        if sides.setdefault(name, crossing.side) != crossing.side:
            raise wrong(
                f" crosses joint {name} twice, as {sides[name]} and as {crossing.side}; where it runs back over a "
                "pulley that moves it must be on one side"
            )
        joint = known[name]
        if crossing.angle is not None and joint.mechanism != "continuum":
            raise wrong(f" crosses joint {name} at an angle, but it is a {joint.mechanism}; give its side instead")
        near = joint.radius if crossing.radius is None else crossing.radius
        widest = max(near, crossing.far_radius or 0.0)
        if joint.mechanism == "continuum" and widest * joint.range >= (joint.backbone_length or 0.0):
            raise wrong(
                f" runs {widest:g} m from the middle of {name}, of which {joint.backbone_length:g} m bend by up to "
                f"{joint.range:.3g} rad: nothing would be left of it on the inner side; it must run nearer"
            )
