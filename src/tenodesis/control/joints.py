"""Observer and law for any routing: all joints of an instrument from the drive end of all its tendons."""

from __future__ import annotations

from math import hypot, sqrt
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core
from tenodesis.control.controller import LoopState, OperatingState, Request, as_request, fault_names
from tenodesis.control.pairs import names_of
from tenodesis.control.parameters import FAULT_OVER_LIMIT, FAULTS, GAIN_PER_SWING, limits, tension_limit
from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.plant import TIME_STEP, natural_frequencies, twin_rows, twin_values
from tenodesis.run import Array, Names

_NAMES = [name for name, _, _ in _core.joint_control_parameters()]
_COMPONENTS = 7
"""Of the load: force, moment, grip."""
_DEVIATIONS = 1.0
"""Of an estimate, that strokes leave room for."""
_KNOWN = 1e-6
"""Deviation of a share that is known exactly."""
_PLAY = 4.0
"""Deviations of sensors by which a tendon counts as slipping; part of a step that a spool at rest stays within."""
_SMOOTHING = 0.05
"""Time over which the handle's encoder is smoothed where slip is found from it, s."""
_SPOOL_LAG = 0.4
"""Gain of the spools' positions by the inverse of the drives' time constant: without overshoot."""
_LAW_SHARE = 0.2
"""Rate of the law over that gain, so that spools follow it."""
_ENGAGE_TIME = 0.2
"""In which the law begins to move the motors, s."""
_STROKES = 3.0
"""Largest stroke of a tendon beyond its target, in stretches by the largest tension."""
_HANDLE_STEPS, _SPOOL_STEPS = 6.0, 2.5
"""By which two readings of an encoder at rest differ at most, in its steps."""
_HOMING_TIME, _HOMING_RISE = 2.0, 0.6
"""Of homing: time, s, and rise of the tensions as a share of the pretension, that all contacts slip both ways."""
_LIMIT_SHARE = 0.8
"""Part of what is left up to the tension limit that homing takes."""
_IMBALANCE = 1e-3
"""Moment of a joint that no load explains, as a share of what tendons can hold."""


JointLawName: TypeAlias = Literal["off", "joints"]
"""Law of all joints: motors follow the targets alone, or give back what joints lose."""


class JointEstimate(NamedTuple):
    """What tendons show of the joints, at one tick or with a row per tick."""

    angle: Array
    """rad, (..., joints)"""
    angle_std: Array
    """rad, (..., joints)"""
    moment: Array
    """Of the tendons about the joints, N m, (..., joints)"""
    load: Array
    """Force (N) and moment (N m) at the tip in its axes, and grip force (N), (..., 7)"""
    load_std: Array
    friction_scale: Array
    """Friction over the file's"""
    friction_scale_std: Array
    far_tension: Array
    """At the ends of the tendons, N, (..., tendons)"""
    unexplained: Array
    """Tension that a tendon would have to have more for its length, N, (..., tendons)"""
    unexplained_std: Array
    covariance: Array
    """Of the angles, rad^2, (..., joints, joints)"""

    @classmethod
    def of_rows(cls, rows: Array, joints: int, tendons: int) -> JointEstimate:
        """Return it from the core's numbers, (..., width)."""
        widths = [joints] * 3 + [_COMPONENTS] * 2 + [1, 1] + [tendons] * 3 + [joints**2]
        found = dict(zip(cls._fields, np.split(rows, np.cumsum(widths)[:-1], axis=-1), strict=True))
        for name in ("friction_scale", "friction_scale_std"):
            found[name] = found[name][..., 0]
        found["covariance"] = found["covariance"].reshape(*rows.shape[:-1], joints, joints)
        return cls(**found)


class JointOutput(NamedTuple):
    """Result of one tick."""

    spool_velocity: Array
    """To send to the drives, rad/s, (tendons,)"""
    estimate: JointEstimate
    state: OperatingState
    faults: tuple[str, ...]
    """Names of the latched faults; outside a fault, of the conditions that hold now"""
    first_faults: tuple[str, ...]
    """Names of the faults that came first"""


class JointController(LoopState):
    """Observer, law and supervisor of all joints of any instrument, with or without a handle.

    Targets are the angles that joints had if no tendon stretched: of an instrument with a handle those of its handle,
    of a tool without one those that are commanded. The motors give back what the joints lose, as far as it exceeds the
    estimate's deviation, but leave the grip as commanded where something presses the jaws apart; tendons about to go
    slack are tightened without turning a joint. A fault is latched, and the motors stand from then on.

    Parameters
    ----------
    inst
        The instrument: its table friction is the observer's assumption, its table control has uncertainties and limits.
    law
        ``joints``: the motors give back what is lost; ``off``: they follow the targets alone, as by a rigid coupling
        matrix.
    enabled
        Whether the first tick enables it.
    period
        Time between ticks, s; by default the instrument's sampling period.
    pure_force
        Whether nothing acts on the tip but a force, and no moment: tendons can hardly tell these apart.

    Raises
    ------
    ValueError
        The law is unknown, `control.observe` asks for dither, neither tendon nor spring holds a joint, or the period is
        not above 0 and below 1 s.
    """

    estimate: JointEstimate
    """Of the last run on a twin, with a row per step."""

    def __init__(
        self,
        inst: InstrumentLike,
        law: JointLawName = "joints",
        *,
        enabled: bool = True,
        period: float | None = None,
        pure_force: bool = False,
    ) -> None:
        given = expanded(inst)
        if law not in get_args(JointLawName):
            raise ArgumentError(key="law", value=law, allowed=f"one of {', '.join(get_args(JointLawName))}")
        if given.control.observe != "strokes":
            raise ArgumentError(key="observe", value=given.control.observe, allowed="strokes, by the law of all joints")
        self.inst, self.law = given, law
        self.period = 1 / given.sensors.sampling_rate if period is None else period
        if not 0 < self.period < 1:
            raise ArgumentError(key="period", value=period, allowed="a time above 0 and below 1 s")
        super().__init__(enabled=enabled)
        rows = twin_rows(given, TIME_STEP, quasi_static=True)
        values = twin_values(given, TIME_STEP) | _values(given, self.period)
        if pure_force:
            values["moment_deviation"] *= _KNOWN
        self.numbers = {name: float(values[name]) for name in _NAMES}
        pretension = float(np.max(given.pretensions))
        found = limits(given, self.period, pretension, given.tension_sensors[0])
        # Before a slack tendon is taut again, friction unlike the observer's explains as much, too.
        least, persistence = found["tendon_break"]
        found["tendon_break"] = least + values["unlike_friction"], persistence
        self.rows, self.limits = rows, found
        checks = np.array([found[name] for name in (*FAULTS, "spool_jump")])
        self.core = _core.JointController(
            given.core, rows.passages, rows.contacts, rows.segments, list(self.numbers.values()), checks, rows.law
        )

    def __repr__(self) -> str:
        return f"<JointController for {self.inst.name!r}: {len(self.inst.tip_joints)} joints, law {self.law}>"

    def step(
        self,
        tensions: ArrayLike,
        spool_angles: ArrayLike,
        handle_angle: ArrayLike = (),
        target: ArrayLike | None = None,
        request: Request | str = Request.NONE,
        *,
        since: float | None = None,
    ) -> JointOutput:
        """Step the controller by one tick.

        Parameters
        ----------
        tensions
            Beside the spools, N, by tendon.
        spool_angles
            rad, from the pretension at straight joints, positive winds; by tendon.
        handle_angle
            rad, by joint of the handle.
        target
            Of a tool without a handle: angles commanded, rad, by joint of the tip; by default straight.
        request
            Request of this tick, a :class:`Request` or its name; :meth:`ask` queues one too.
        since
            Time since the last tick, s; by default the period.

        Raises
        ------
        ValueError
            A shape does not fit the instrument, or there is no such request. Measurements may have any value, NaN
            included: that is a fault, not an error.
        """
        asked = as_request(request)
        if asked == Request.NONE:
            asked = self.take_request()
        self._ran = None, 0.0
        joints, tendons = len(self.inst.tip_joints), len(self.inst.tendons)
        out = np.empty(self.core.stored)
        wanted = np.zeros(joints) if target is None else target
        handle, tension, spool, aim = (
            np.ascontiguousarray(one, float) for one in (handle_angle, tensions, spool_angles, wanted)
        )
        elapsed = self.period if since is None else float(since)
        self.core.step(handle, tension, spool, aim, int(asked), self.compensates, elapsed, out)
        state, faults, first = out[-3:].astype(int).tolist()
        width = self.core.width
        return JointOutput(
            out[width : width + tendons],
            JointEstimate.of_rows(out[:width], joints, tendons),
            OperatingState(state),
            fault_names(faults),
            fault_names(first),
        )

    def observe(self, tensions: ArrayLike, spool_angles: ArrayLike, handle_angle: ArrayLike) -> JointEstimate:
        """Return what rows of a recording show, a period apart, by :meth:`step` from a reset on; nothing is commanded.

        Shapes (n, tendons), (n, tendons) and (n, joints of the handle), in N and rad.
        """
        self.reset()
        straight, out = np.zeros(len(self.inst.tip_joints)), np.empty((len(np.asarray(tensions)), self.core.stored))
        given = (np.ascontiguousarray(one, float) for one in (handle_angle, tensions, spool_angles))
        for handle, tension, spool, row in zip(*given, out, strict=True):
            self.core.step(handle, tension, spool, straight, int(Request.NONE), False, self.period, row)
        self.signals_of(out)
        return self.estimate

    def count_from(self, spool_angles: ArrayLike) -> None:
        """Count spool angles from these (rad, by tendon), at which tendons have their pretension at straight joints."""
        self.core.count_from(np.ascontiguousarray(spool_angles, float))

    @property
    def compensates(self) -> bool:
        """Whether the motors give back what joints lose."""
        return self.law == "joints"

    def reset(self) -> None:
        """Return to the state in which it was made."""
        self.core.reset()
        self.forget()

    def names_of(self, inst: InstrumentLike) -> Names:
        """Return what the columns of a run on an instrument are named after: it serves all joints.

        Raises
        ------
        ValueError
            The instrument has other joints or tendons than the controller's.
        """
        own, theirs = (names_of(one) for one in (self.inst, inst))
        if own[:3] != theirs[:3]:
            raise ArgumentError(
                f"the controller is for {_listed(own)}; the twin must be of such an instrument, not one with "
                f"{_listed(theirs)}.",
                key="controller",
            )
        return theirs._replace(compensated=theirs.joints)

    def check_instrument(self, inst: InstrumentLike) -> None:
        """Raise ValueError for an instrument with other joints or tendons than the controller's."""
        self.names_of(inst)

    def signals_of(self, rows: Array) -> dict[str, Array]:
        """Return the signals of a run in the core's numbers (n, stored), and keep the estimate."""
        joints, tendons = len(self.inst.tip_joints), len(self.inst.tendons)
        width = self.core.width
        self.estimate = JointEstimate.of_rows(rows[:, :width], joints, tendons)
        of_all = {
            "friction_scale": self.estimate.friction_scale,
            "friction_scale_std": self.estimate.friction_scale_std,
            "operating_state": rows[:, -3],
            "faults": rows[:, -2],
        }
        aims = {} if self.inst.handle_joints else {"commanded_output_angle": rows[:, -3 - joints : -3]}
        return {
            **aims,
            "commanded_spool_velocity": rows[:, width : width + tendons],
            "estimated_output_angle": self.estimate.angle,
            "estimated_output_angle_std": self.estimate.angle_std,
            **{name: np.repeat(values[:, np.newaxis], joints, axis=1) for name, values in of_all.items()},
        }


def _listed(names: Names) -> str:
    return f"the joints {', '.join(names.joints)} and the tendons {', '.join(names.tendons)}"


def _values(inst: FullForm, period: float) -> dict[str, float]:
    """Return the numbers of observer and law that are not the plant's, by the core's names."""
    control, sensor, drives = inst.control, inst.tension_sensors[0], inst.own_drives
    step = 2 * np.pi / drives.encoder_counts / drives.gear_ratio * drives.spool_radius
    sensors, handle_arms = inst.sensors, inst.tendon_arms("handle")
    resolution = sensors.encoder_range / 2**sensors.encoder_bits
    drawn = float(np.max(np.abs(handle_arms), initial=0.0)) * hypot(sensors.encoder_noise, resolution)
    smoothing = period / (_SMOOTHING + period)
    arms = np.abs(inst.tendon_arms("tip"))
    pretension = float(np.max(inst.pretensions))
    held = float(np.max(arms.T @ np.maximum(inst.pretensions, _IMBALANCE * pretension)))
    last = max(joint.end_effector_length or 0.0 for joint in inst.tip_joints)
    reach = last + sum(joint.offset + joint.chord for joint in inst.tip_joints) or float(np.max(arms))
    speed, limit = drives.motor_speed / drives.gear_ratio, tension_limit(inst)
    stiffness = float(np.min(inst.stiffnesses))
    gain = min(_SPOOL_LAG / max(drives.time_constant, period), 1 / (10 * period))
    return {
        "play": step / _PLAY,
        "spool_step": step / drives.spool_radius,
        "handle_play": _PLAY * drawn * sqrt(smoothing / 2),
        "tension_play": _PLAY * (sensor.noise + sensor.resolution),
        "smoothing": smoothing,
        "tension_deviation": hypot(sensor.noise, sensor.resolution, sensor.offset),
        "length_deviation": hypot(step / sqrt(12), drawn, control.reference_uncertainty),
        "friction_deviation": max(control.friction_uncertainty, _KNOWN),
        "stiffness_deviation": max(control.stiffness_uncertainty, _KNOWN),
        "force_deviation": held / reach,
        "moment_deviation": held,
        "grip_deviation": held / reach,
        "imbalance": _IMBALANCE * held,
        "rate": min(_LAW_SHARE * gain, GAIN_PER_SWING * float(natural_frequencies(inst)[0])),
        "gain": gain,
        "speed": speed * drives.spool_radius,
        "tension_limit": limit,
        "least_tension": control.least_tension,
        "deviations": _DEVIATIONS,
        "homing_time": _HOMING_TIME,
        "homing_rise": min(_HOMING_RISE, _LIMIT_SHARE * max(limit / pretension - 1, 0)) if pretension else 0.0,
        "period": period,
        "speed_limit": speed,
        "acceleration_limit": drives.motor_acceleration / drives.gear_ratio,
        "drive_time_constant": drives.time_constant,
        "engage_time": _ENGAGE_TIME,
        "tension_of_fault": FAULT_OVER_LIMIT * limit,
        "unlike_friction": control.mean_band * pretension,
        "stroke_limit": _STROKES * limit / stiffness,
        "pretension": pretension,
        "stiffness": stiffness,
        "load_cell_range": sensor.range - sensor.resolution,
        "handle_range": max((joint.range for joint in inst.handle_joints), default=1.0),
        "handle_noise": _HANDLE_STEPS * max(resolution, 2 * sensors.encoder_noise),
        "spool_noise": _SPOOL_STEPS * step / drives.spool_radius,
    }
