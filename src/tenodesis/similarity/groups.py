"""The dimensionless groups of an instrument, statics to drives, by what each of them governs."""

from math import isnan, nan
from typing import Literal, NamedTuple, TypeAlias

from tenodesis import plant, statics
from tenodesis.instrument import ShortForm
from tenodesis.instrument.compliance import compliance_shares
from tenodesis.similarity.parameters import tension_scale

Kind: TypeAlias = Literal["elastic", "load", "pretension", "slack", "friction", "handle", "motor", "inertia"]
"""What a dimensionless group describes."""

SAME = 1e-9
"""Relative difference up to which two groups count as equal."""


IMPOSED = ("Theta", "J/(kappa t^2)")
"""Groups that are equal in any two instruments, since the factors of force and of time follow from them."""


def near(one: float, other: float) -> bool:
    """Return whether two values of a group count as equal."""
    return abs(other - one) <= SAME * abs(one)


class Definition(NamedTuple):
    """Definition of a group, and what it governs."""

    kind: Kind
    meaning: str


DEFINITIONS: dict[str, Definition] = {
    "R/r": Definition("elastic", "proximal over distal radius: output angle per handle angle (eq. 18)"),
    "l_d/r": Definition("elastic", "end-effector over distal radius: tendon tension per tip force (eq. 1)"),
    "L_b/r": Definition("elastic", "length of the backbone over the tendons' offset"),
    "EI/(k r^2 L_b)": Definition("elastic", "bending stiffness of the backbone over that of one tendon"),
    "handle share": Definition("elastic", "share of the tendon's compliance between spool and handle joint"),
    "proximal joint share": Definition("elastic", "share of the tendon's compliance in the handle's joint"),
    "stem share": Definition("elastic", "share of the tendon's compliance in the stem"),
    "distal joint share": Definition("elastic", "share of the tendon's compliance in the tip's joint"),
    "anchor share": Definition("elastic", "share of the tendon's compliance beyond a second vertex of the tip's joint"),
    "theta_stop": Definition("elastic", "output angle of the mechanical stop, rad"),
    "F/(kr)": Definition("load", "tip force over the tension that stretches a tendon by the distal radius"),
    "Theta": Definition("load", "loss of dexterity at mid-range under the largest force, rad (eq. 17)"),
    "T_o/(kr)": Definition("pretension", "pretension over the tension that stretches a tendon by the distal radius"),
    "F_slack/F": Definition(
        "slack", "force that slackens a tendon, the tip held straight, over the largest force (eq. 8)"
    ),
    "mu": Definition("friction", "friction coefficient at the joints' vertices"),
    "mu_s": Definition("friction", "friction coefficient in the sheath"),
    "phi_s": Definition("friction", "bend of the sheath with the handle straight, rad"),
    "dphi_s/dtheta_h": Definition("friction", "bend of the sheath added per angle of the handle"),
    "n_s": Definition("friction", "contacts that make up the sheath"),
    "n_v": Definition("friction", "vertices of a joint"),
    "phi_0": Definition("friction", "wrap angle of a joint when it is straight, rad"),
    "n": Definition("friction", "power of the tension that friction grows with"),
    "T_r/(kr)": Definition("friction", "tension at which the coefficients are given, over k r"),
    "r_v/r_r": Definition("friction", "radius of the vertices over that at which their coefficient is given"),
    "B/(2 r_v^2 k r)": Definition("friction", "loss of bending a tendon over a vertex over k r"),
    "f_c/(kr)": Definition("friction", "constant friction of a joint over k r"),
    "c_v/(kt)": Definition("friction", "viscous friction of a joint over stiffness times the tip's time"),
    "mu_0/mu": Definition("friction", "static over kinetic friction coefficient"),
    "v_S t/r": Definition("friction", "Stribeck speed by the tip's time over the distal radius"),
    "t_f/t": Definition("friction", "time by which friction lags over the tip's time"),
    "l_p/R": Definition("handle", "handle over proximal radius: governs the torque at the handle only (eq. 13)"),
    "v_m t/r": Definition("motor", "largest tendon speed of the drive by the tip's time over the distal radius"),
    "a_m t^2/r": Definition("motor", "largest tendon acceleration of the drive, likewise"),
    "t_m/t": Definition("motor", "time constant of the drive over the tip's time"),
    "b r_s/r": Definition("motor", "tendon length within the drive's backlash over the distal radius"),
    "q r_s/r": Definition("motor", "tendon length per count of the motor's encoder over the distal radius"),
    "J/(kappa t^2)": Definition("inertia", "tip inertia over stiffness by time squared, times by the time factor"),
    "zeta": Definition("inertia", "damping ratio of the straight, unloaded tip"),
    "K_h/(k R^2)": Definition("inertia", "stiffness of the hand over that of one tendon at the handle"),
    "J_h/(K_h t^2)": Definition("inertia", "inertia of the hand over its stiffness by the tip's time squared"),
    "c_h/(K_h t)": Definition("inertia", "damping of the hand over its stiffness by the tip's time"),
}
"""Every group by name, in the order they are shown in; the tip's time t is that of :func:`unit_of_time`."""


class Group(NamedTuple):
    """A dimensionless group and its value in both instruments; NaN for an instrument that has no such group."""

    name: str
    kind: Kind
    meaning: str
    """Definition of the group, in one line."""
    real_size: float
    scaled_up: float

    @property
    def ratio(self) -> float:
        """Scaled-up over real-size, NaN where the real-size value is zero."""
        return self.scaled_up / self.real_size if self.real_size else nan

    @property
    def imposed(self) -> bool:
        """Whether the group is equal by the choice of the force or time factor, which shows no similarity."""
        return self.name in IMPOSED

    @property
    def matches(self) -> bool:
        """Whether the group is the same in both instruments."""
        return near(self.real_size, self.scaled_up)


def unit_of_time(inst: ShortForm) -> float:
    """Return sqrt(J / kappa), the period of the straight tip over two pi, s."""
    return 1 / plant.natural_frequency(inst)


def groups_of(inst: ShortForm) -> dict[str, float]:
    """Return the groups of an instrument by name, without those of the load (Tables I and II, physics of the twin).

    The spools' radius has a factor but no group: only the tendon length it winds counts. Groups of the Stribeck law,
    of a power of the tension, of two vertices, base wrap and bending, and of a compliant hand are included for
    instruments that have them.
    """
    values = plant.parameters(inst)
    distal, proximal = values["distal_radius"], values["proximal_radius"]
    stiffness, tension, time = inst.tendon_stiffness, tension_scale(inst), unit_of_time(inst)
    shares, friction = compliance_shares(inst), inst.friction
    spool = values["spool_radius"]
    kappa = float(statics.flexural_stiffness(inst, 0.0))
    groups = {
        "R/r": proximal / distal,
        "l_d/r": values["end_effector_length"] / distal,
        "l_p/R": values["handle_length"] / proximal,
        "T_o/(kr)": inst.pretension / tension,
        "handle share": shares.handle,
        "proximal joint share": shares.handle_joint,
        "stem share": shares.stem,
        "distal joint share": shares.tip_joint,
        "theta_stop": values["output_stop"],
        "mu": values["vertex_coefficient"],
        "mu_s": values["sheath_coefficient"],
        "phi_s": values["sheath_bend"],
        "dphi_s/dtheta_h": values["sheath_bend_rate"],
        "n_s": float(friction.sheath_contacts),
        "f_c/(kr)": values["constant"] / tension,
        "c_v/(kt)": values["viscous"] / (stiffness * time),
        "v_m t/r": spool * values["spool_speed_limit"] * time / distal,
        "a_m t^2/r": spool * values["spool_acceleration_limit"] * time**2 / distal,
        "t_m/t": values["drive_time_constant"] / time,
        "b r_s/r": spool * values["backlash"] / distal,
        "q r_s/r": spool * values["motor_encoder_resolution"] / distal,
        "zeta": values["tip_damping"] / (2 * kappa * time),
    }
    if inst.joint_type == "continuum":
        length = values["backbone_length"]
        groups |= {
            "L_b/r": length / distal,
            "EI/(k r^2 L_b)": values["backbone_rigidity"] / (stiffness * distal**2 * length),
        }
    if friction.vertices_per_joint > 1:
        groups |= {"n_v": float(friction.vertices_per_joint), "anchor share": shares.anchor}
    if friction.base_wrap:
        groups["phi_0"] = friction.base_wrap
    if friction.law == "capstan-power":
        groups |= {
            "n": friction.load_index,
            "T_r/(kr)": friction.reference_tension / tension,
            "r_v/r_r": values["vertex_radius_ratio"],
        }
    if friction.tendon_bending_stiffness:
        groups["B/(2 r_v^2 k r)"] = values["bending_loss"] / tension
    if friction.law == "stribeck":
        groups |= {
            "mu_0/mu": values["static_ratio"],
            "v_S t/r": values["stribeck_speed"] * time / distal,
            "t_f/t": values["memory"] / time,
        }
    hand = values["hand_stiffness"]
    if hand:
        groups |= {
            "K_h/(k R^2)": hand / (stiffness * proximal**2),
            "J_h/(K_h t^2)": values["hand_inertia"] / (hand * time**2),
            "c_h/(K_h t)": values["hand_damping"] / (hand * time),
        }
    return groups


def groups_under_load(inst: ShortForm, force: float, mid_range: float, time: float) -> dict[str, float]:
    """Return the groups of load, slack and inertia at a tip force (N), an output angle (rad) and a time (s)."""
    return {
        "F/(kr)": force / tension_scale(inst),
        "Theta": float(statics.loss_of_dexterity(inst, mid_range, force)),
        "F_slack/F": float(statics.slack_force(inst, 0.0)) / force,
        "J/(kappa t^2)": (unit_of_time(inst) / time) ** 2,
    }


def paired(real_size: dict[str, float], scaled_up: dict[str, float]) -> tuple[Group, ...]:
    """Return the groups that either instrument has, in the order of their definitions."""
    pairs = ((name, real_size.get(name, nan), scaled_up.get(name, nan)) for name in DEFINITIONS)
    return tuple(
        Group(name, *DEFINITIONS[name], ours, theirs)
        for name, ours, theirs in pairs
        if not (isnan(ours) and isnan(theirs))
    )
