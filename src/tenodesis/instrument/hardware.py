"""Tables of an instrument file beyond the statics: friction, dynamics, drives, sensors, mismatch, control, geometry."""

import math
from itertools import pairwise
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from tenodesis.errors import ArgumentError
from tenodesis.toml import FileTable
from tenodesis.units import (
    Angle,
    AngleError,
    BendingStiffness,
    Bits,
    Coefficient,
    Current,
    CurrentError,
    Damping,
    EncoderRange,
    Force,
    FrictionTorque,
    Gain,
    HandStiffness,
    HomingSpeed,
    Inertia,
    Length,
    LengthDeviation,
    LoadCellRange,
    MotorAcceleration,
    MotorSpeed,
    PivotRange,
    PositiveForce,
    Rate,
    Ratio,
    Share,
    SheathBend,
    SignedForce,
    SlipSpeed,
    Spacing,
    StopAngle,
    TendonSpeedLimit,
    Time,
    TorqueConstant,
    TurnRange,
    Viscosity,
)

MOST_EXPONENT = 10.0
"""Largest friction exponent of a contact; above it, rounding of the tension ratio would violate the law."""

SafeState: TypeAlias = Literal["hold", "neutral"]
StopMode: TypeAlias = Literal["return", "hold"]
Observe: TypeAlias = Literal["strokes", "dither", "auto"]
FrictionLaw: TypeAlias = Literal["none", "capstan", "capstan-constant", "stribeck", "capstan-power"]
ComplianceShare = Annotated[float, Field(gt=0, lt=1)]


class Friction(FileTable):
    """Friction between a tendon and the surfaces it bends around; without this table there is no friction."""

    law: FrictionLaw = Field(default="none", description="none, capstan, capstan-constant, stribeck or capstan-power")
    vertex_coefficient: Coefficient = Field(default=0.0, description="Friction coefficient at the joints' vertices")
    sheath_coefficient: Coefficient = Field(default=0.0, description="Friction coefficient in the sheath")
    sheath_bend: SheathBend = Field(default=0.0, description="Total bend of the sheath with the handle straight")
    sheath_bend_per_handle_angle: Coefficient = Field(default=0.0, description="Bend added per angle of the handle")
    sheath_contacts: int = Field(default=1, ge=1, le=32, strict=True, description="Contacts that make up the sheath")
    vertices_per_joint: int = Field(
        default=1, ge=1, le=2, strict=True, description="Contacts of a joint: 1, or 2 with the drawn span between them"
    )
    base_wrap: AngleError = Field(
        default=0.0, description="Bend over the vertices of a straight joint, to which its angle adds either way"
    )
    handle_compliance_share: ComplianceShare | None = Field(
        default=None,
        description="Share of a tendon's compliance between spool and handle joint; without it, by the handle's length",
    )
    handle_joint_compliance_share: ComplianceShare | None = Field(
        default=None, description="Share in the span of the handle's joint; without it, by the joint's length"
    )
    tip_joint_compliance_share: ComplianceShare | None = Field(
        default=None, description="Share in the span of the tip's joint; without it, by the joint's length"
    )
    anchor_compliance_share: ComplianceShare | None = Field(
        default=None, description="Share beyond a second vertex of the tip's joint; without it, half the joint's"
    )
    load_index: Annotated[float, Field(ge=0.3, le=1)] = Field(
        default=1.0, description="Power of the tension that friction of capstan-power grows with; 1 is capstan"
    )
    reference_tension: PositiveForce = Field(
        default=1.0, description="Tension at which the coefficients of capstan-power are given"
    )
    reference_radius: Length = Field(
        default=1e-3, description="Vertex radius at which the vertex coefficient of capstan-power is given"
    )
    vertex_radius: Length | None = Field(
        default=None, description="Radius of the vertices, for capstan-power and for bending; without it no effect"
    )
    tendon_bending_stiffness: BendingStiffness = Field(
        default=0.0, description="Bending stiffness of a tendon that does not spring back where it leaves a vertex"
    )
    constant: Force = Field(default=0.0, description="Load-independent friction of each joint and of the sheath")
    viscous: Viscosity = Field(default=0.0, description="Viscous friction of each joint and of the sheath")
    passing_coefficient: Coefficient = Field(
        default=0.0,
        description="For a controller: friction coefficient where the second axis's tendons pass the first's joints",
    )
    static_ratio: Annotated[float, Field(ge=1, le=10)] = Field(
        default=1.0, description="Static over kinetic coefficient of the Stribeck law"
    )
    stribeck_speed: SlipSpeed = Field(
        default=1e-3, description="Slip speed at which static friction has mostly vanished"
    )
    memory: Time = Field(default=5e-3, description="Time by which friction lags behind the slip speed")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.law == "none" and (self.vertex_coefficient or self.sheath_coefficient or self.constant):
            raise ArgumentError(
                'law is "none", but coefficients are given; give another law or no coefficients', key="law"
            )
        if self.law in ("none", "capstan") and self.constant:
            raise ArgumentError(
                f'constant is {self.constant:g} N, which law "{self.law}" does not have',
                key="constant",
                value=self.constant,
            )
        if self.law != "stribeck" and self.static_ratio != 1:
            raise ArgumentError(f'static_ratio is {self.static_ratio:g}, which only law "stribeck" has')
        self._check_shares()
        self._check_radius()
        bend = self.sheath_bend + self.sheath_bend_per_handle_angle * math.pi
        exponents = {
            "vertex_coefficient": self.vertex_coefficient
            * self.static_ratio
            * self.vertex_factor
            * (math.pi + self.base_wrap)
            / self.vertices_per_joint,
            "sheath_coefficient": self.sheath_coefficient * self.static_ratio * bend / self.sheath_contacts,
        }
        for key, exponent in exponents.items():
            if exponent > MOST_EXPONENT:
                raise ArgumentError(
                    f"{key} is {getattr(self, key):g}, which with static_ratio and bend makes a friction exponent of "
                    f"{exponent:.3g} at one contact; it must be at most {MOST_EXPONENT:g}: give a smaller coefficient "
                    "or bend, or more sheath_contacts"
                )
        return self

    def _check_shares(self) -> None:
        if self.anchor_compliance_share is not None and self.vertices_per_joint == 1:
            raise ArgumentError(
                f"anchor_compliance_share is {self.anchor_compliance_share:g}, which only joints of two vertices have; "
                "give vertices_per_joint = 2, or no share"
            )
        keys = [f"{place}_compliance_share" for place in ("handle", "handle_joint", "tip_joint", "anchor")]
        given = {key: value for key in keys if (value := getattr(self, key)) is not None}
        total = sum(given.values())
        if total >= 1:
            raise ArgumentError(
                f"{' and '.join(given)} make {total:.4g} of the tendon's compliance; they must be below 1 together, "
                "the rest being the stem's"
            )

    def _check_radius(self) -> None:
        if self.law != "capstan-power" and self.load_index != 1:
            raise ArgumentError(f'load_index is {self.load_index:g}, which only law "capstan-power" has')
        stiffness = self.tendon_bending_stiffness
        if stiffness and self.vertex_radius is None:
            raise ArgumentError(f"tendon_bending_stiffness is {stiffness:g} N*m^2, which needs a vertex_radius")
        if stiffness and self.law in ("none", "stribeck"):
            raise ArgumentError(
                f'tendon_bending_stiffness is {stiffness:g} N*m^2, which law "{self.law}" does not have; give another '
                "law, or none"
            )

    @property
    def bends(self) -> bool:
        """Whether bending the tendons over the vertices costs anything."""
        return self.tendon_bending_stiffness > 0

    @property
    def vertex_factor(self) -> float:
        """Ratio of the coefficient at the vertices to that at the reference radius: pressure falls with the radius."""
        ratio = 1.0 if self.vertex_radius is None else self.vertex_radius / self.reference_radius
        return float(ratio ** (1 - self.load_index))


class Hand(FileTable):
    """The hand on the handle."""

    hand_stiffness: HandStiffness = Field(
        default=0.0, description="Stiffness of the hand on the handle; 0: the handle is at its commanded angle"
    )
    hand_damping: Damping = Field(default=0.05, description="Damping of the hand on the handle")
    hand_inertia: Inertia = Field(default=2e-3, description="Inertia of hand and handle")


class Dynamics(Hand):
    """Inertia and damping of tip and hand."""

    tip_inertia: Inertia | None = Field(
        default=None, description="Inertia about the output angle; without it the unloaded tip has 20 Hz"
    )
    tip_damping: Damping | None = Field(
        default=None, description="Viscous damping of the output angle; without it a fifth of critical damping"
    )
    output_stop: StopAngle | None = Field(
        default=None, description="Output angle of the mechanical stop; without it a third beyond the working range"
    )


class Drives(FileTable):
    """Spools on speed-controlled motors; speeds are the motor's."""

    spool_radius: Length = Field(default=5e-3, description="Radius of the spools")
    gear_ratio: Annotated[float, Field(gt=0, le=1e4)] = Field(default=1.0, description="Motor turns per spool turn")
    motor_speed: MotorSpeed = Field(default=20.0, description="Largest speed of the motor")
    motor_acceleration: MotorAcceleration = Field(default=400.0, description="Largest acceleration of the motor")
    time_constant: Time = Field(default=0.01, description="Time constant of the speed loop")
    backlash: AngleError = Field(default=0.0, description="Backlash of the gearbox, at the spool")
    encoder_counts: int = Field(default=4096, ge=1, le=2**24, strict=True, description="Counts per turn of the motor")
    torque_constant: TorqueConstant | None = Field(
        default=None, description="Torque of the cold motor per current, for sensors of kind current"
    )
    gear_efficiency: Annotated[float, Field(ge=0.05, le=1)] = Field(
        default=1.0, description="Efficiency of the gearbox in either direction, as currents show it"
    )
    friction_torque: FrictionTorque = Field(
        default=0.0, description="Load-independent friction of motor and gearbox, at the spool, as currents show it"
    )
    torque_ripple: Annotated[float, Field(ge=0, lt=0.5)] = Field(
        default=0.02, description="Amplitude of the torque's ripple over the torque, 12 periods per turn of the motor"
    )
    thermal_drift: Annotated[float, Field(ge=0, lt=0.5)] = Field(
        default=0.0, description="Share by which the torque constant falls as the motor warms up"
    )
    thermal_time: Annotated[Time, Field(gt=0)] = Field(default=600.0, description="Time constant of warming up")


class Sensors(FileTable):
    """Analogue joint encoders, load cells or motor currents, and how often they are sampled."""

    kind: Literal["load-cell", "current"] = Field(
        default="load-cell", description="What measures the tensions: load-cell, or the motors' current"
    )
    sampling_rate: Rate = Field(default=2000.0, description="Samples per second")
    encoder_bits: Bits = Field(default=12, description="Bits of the converter of a joint encoder")
    encoder_range: EncoderRange = Field(default=2 * math.pi, description="Angle over the converter's range")
    encoder_noise: AngleError = Field(default=math.radians(0.03), description="Standard deviation of an encoder")
    load_cell_range: LoadCellRange = Field(default=200.0, description="Largest tension a load cell can measure")
    load_cell_bits: Bits = Field(default=16, description="Bits of the converter of a load cell")
    load_cell_noise: Force = Field(default=0.03, description="Standard deviation of a load cell")
    encoder_offset: AngleError = Field(
        default=math.radians(0.05), description="Standard deviation of a joint encoder's constant error, as calibrated"
    )
    load_cell_offset: Force = Field(default=0.1, description="The same of a load cell, as tared")
    load_cell_gain_error: Annotated[float, Field(ge=0, lt=0.5)] = Field(
        default=0.005, description="Standard deviation of a load cell's gain, as calibrated"
    )
    current_range: Current | None = Field(default=None, description="Largest current that a drive reports")
    current_bits: Bits = Field(default=12, description="Bits of the current's converter")
    current_noise: CurrentError | None = Field(
        default=None, description="Standard deviation of a current; without it a 500th of its range"
    )
    current_offset: CurrentError | None = Field(
        default=None, description="Standard deviation of a current's constant error; without it a 1000th of its range"
    )
    torque_constant_error: Annotated[float, Field(ge=0, lt=0.5)] = Field(
        default=0.01, description="Standard deviation of the torque constant, as calibrated"
    )

    @model_validator(mode="after")
    def _range(self) -> Self:
        if self.kind == "current" and self.current_range is None:
            raise ArgumentError('kind is "current", but current_range is not given; give the largest current')
        return self


class Mismatch(FileTable):
    """Differences of the instrument on the bench from its file, and of its sensors from the truth."""

    stiffness_ratio: Ratio = Field(default=1.0, description="True over nominal stiffness of the tendons")
    pretension_ratio: Ratio = Field(default=1.0, description="True over nominal pretension")
    handle_encoder_offset: Angle = Field(default=0.0, description="Offset of the handle's encoder")
    output_encoder_offset: Angle = Field(default=0.0, description="Offset of the distal encoder")
    load_cell_gain: tuple[Ratio, Ratio] = Field(default=(1.0, 1.0), description="Gains of load cells, or of currents")
    load_cell_bias: tuple[SignedForce, SignedForce] = Field(
        default=(0.0, 0.0), description="Bias of the load cells, or of tensions by current"
    )


class Control(FileTable):
    """Gains, limits and times of the controller; defaults follow from the instrument."""

    dead_band: AngleError = Field(default=math.radians(0.1), description="Angle error that is not corrected")
    gain: Gain | None = Field(
        default=None, description="Gain on the tip's tracking error; without it 12/s, or less for a tip below 8 Hz"
    )
    position_gain: Gain = Field(default=4.0, description="Gain on a spool's set point, for laws with a set point")
    tendon_speed: TendonSpeedLimit | None = Field(
        default=None, description="Largest speed of a tendon at its spool; without it half of the drive's"
    )
    tension_limit: Force | None = Field(
        default=None,
        description=(
            "Tension above which no tendon is wound; without it 80 N, or 3 pretensions if more, but no more than rope "
            "and load cells bear with a margin"
        ),
    )
    force_limit: Force | None = Field(
        default=None, description="Force at the tip beyond which the motors yield; without it 5/3 of the largest load"
    )
    assistance: Annotated[float, Field(ge=0, le=1)] = Field(
        default=1.0, description="Share of the lost angle that the motors give back"
    )
    least_tension: Share = Field(default=0.15, description="Tension that both tendons keep, over the pretension")
    common_stroke: Share = Field(default=0.4, description="Change of tension by a common stroke, over the pretension")
    observe: Observe = Field(
        default="strokes",
        description=(
            "By what the robust law makes the tendons slip to see the tip: common strokes; dither, a common vibration "
            "of both spools for half a second after a change, which the hand feels; auto, dither where the drives "
            "reach 12.5 Hz"
        ),
    )
    friction_uncertainty: Share = Field(default=0.4, description="Initial deviation of the friction scale")
    stiffness_uncertainty: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.25, description="Initial deviation of the tendons' compliance"
    )
    reference_uncertainty: LengthDeviation = Field(
        default=5e-6, description="Standard deviation of a tendon's length at its pretension"
    )
    mean_band: Share = Field(default=0.3, description="Share by which friction may change the mean tension")
    watchdog: Time = Field(default=0.025, description="Time without a tick after which the motors stop")
    stop: StopMode = Field(default="return", description="Motors that are stopped: return home, or hold")
    safe_state: SafeState | None = Field(
        default=None, description="Motors after a fault: hold, or return home (neutral); without it as stop says"
    )
    homing_speed: HomingSpeed = Field(default=5e-3, description="Largest speed at which slack tendons are wound")
    homing_stroke: Length = Field(default=0.03, description="Length wound after which a tendon counts as broken")


class Geometry(FileTable):
    """Lengths along the instrument and limits of its joints; defaults follow from the other lengths."""

    stem_length: Length | None = Field(
        default=None, description="Between the joints' ends nearest to the stem; by default the rest of overall_length"
    )
    joint_spacing: Spacing | None = Field(
        default=None, description="Between two distal joints, from end to end; by default a distal joint's diameter"
    )
    handle_joint_spacing: Spacing | None = Field(
        default=None, description="Between two proximal joints, from end to end; by default a proximal joint's diameter"
    )
    jaw_length: Length | None = Field(
        default=None, description="Length of the jaws, for drawings; by default 0.4 of end_effector_length"
    )
    insertion: Length | None = Field(
        default=None, description="Stem beyond the port at rest; by default half of stem_length"
    )
    least_insertion: Length | None = Field(
        default=None, description="Smallest length of stem beyond the port; by default 0.2 of stem_length"
    )
    most_insertion: Length | None = Field(
        default=None, description="Largest length of stem beyond the port; by default 0.8 of stem_length"
    )
    pivot_range: PivotRange = Field(
        default=math.radians(60), description="Largest pan and largest tilt of the stem about the port, to either side"
    )
    spin_range: TurnRange = Field(default=math.pi, description="Largest spin of the stem about itself, to either side")
    roll_range: TurnRange = Field(default=math.pi, description="Largest roll of the end-effector, to either side")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        given = [
            (key, getattr(self, key))
            for key in ("least_insertion", "insertion", "most_insertion")
            if getattr(self, key) is not None
        ]
        for (low, less), (high, more) in pairwise(given):
            if less > more:
                raise ArgumentError(f"{low} is {less:g} m and {high} is {more:g} m; {low} must be at most {high}")
        return self
