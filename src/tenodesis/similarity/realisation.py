"""An instrument with given groups, and with the mechanism, distal radius, tendon stiffness and time of another."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from tenodesis import _core
from tenodesis.instrument import ShortForm
from tenodesis.instrument.hardware import FrictionLaw
from tenodesis.similarity.groups import unit_of_time
from tenodesis.similarity.parameters import field_of, tension_scale, value_of

_LAWS: tuple[FrictionLaw, ...] = ("none", "capstan", "capstan-constant", "stribeck", "capstan-power")

COUPLED = ("R/r", "l_d/r", "L_b/r", "EI/(k r^2 L_b)", "T_o/(kr)")
"""Groups of the frictionless model that an instrument can be given."""

SEGMENTS = ("handle share", "distal joint share")
"""Groups of the compliance: the proximal joint's share follows from R/r, the stem's is the rest."""

FRICTION = (
    "mu", "mu_s", "phi_s", "dphi_s/dtheta_h", "phi_0", "n", "T_r/(kr)", "r_v/r_r", "f_c/(kr)", "c_v/(kt)",
    "mu_0/mu", "v_S t/r", "t_f/t",
)  # fmt: skip
"""Groups of friction that an instrument can be given."""

_NEUTRAL = {"mu_0/mu": 1.0, "n": 1.0}


class Realisation(NamedTuple):
    """Template, friction law and handle range of instruments with given groups."""

    template: ShortForm
    law: FrictionLaw
    handle_range: float

    def instrument(self, groups: Mapping[str, float]) -> ShortForm:
        """Return the instrument that has these groups, and the template's where a group is not given.

        Raises InstrumentError if no instrument can have them.
        """
        inst = self.template
        radius, stiffness, time = value_of(inst, "distal_radius"), inst.tendon_stiffness, unit_of_time(inst)
        tension = tension_scale(inst)
        units = {
            "mu": ("friction.vertex_coefficient", 1.0),
            "mu_s": ("friction.sheath_coefficient", 1.0),
            "phi_s": ("friction.sheath_bend", 1.0),
            "dphi_s/dtheta_h": ("friction.sheath_bend_per_handle_angle", 1.0),
            "phi_0": ("friction.base_wrap", 1.0),
            "n": ("friction.load_index", 1.0),
            "T_r/(kr)": ("friction.reference_tension", tension),
            "r_v/r_r": ("friction.vertex_radius", inst.friction.reference_radius),
            "f_c/(kr)": ("friction.constant", tension),
            "c_v/(kt)": ("friction.viscous", stiffness * time),
            "mu_0/mu": ("friction.static_ratio", 1.0),
            "v_S t/r": ("friction.stribeck_speed", radius / time),
            "t_f/t": ("friction.memory", time),
            "R/r": (field_of(inst, "proximal_radius"), radius),
            "l_d/r": ("end_effector_length", radius),
            "T_o/(kr)": ("pretension", tension),
        }
        changes: dict[str, Any] = {units[name][0]: groups[name] * units[name][1] for name in units if name in groups}
        length, friction = inst.tendon_length or inst.overall_length, inst.friction
        if "distal joint share" in groups and friction.tip_joint_compliance_share is not None:
            changes["friction.tip_joint_compliance_share"] = groups["distal joint share"]
        elif "distal joint share" in groups:
            length *= _core.joint_shares(inst.spec)[1] / groups["distal joint share"]
        if "handle share" in groups and friction.handle_compliance_share is not None:
            changes["friction.handle_compliance_share"] = groups["handle share"]
        elif "handle share" in groups:
            changes["handle_length"] = groups["handle share"] * length
        if "L_b/r" in groups:
            backbone = groups["L_b/r"] * radius
            changes[field_of(inst, "backbone_length")] = backbone
            changes[field_of(inst, "backbone_rigidity")] = groups["EI/(k r^2 L_b)"] * stiffness * radius**2 * backbone
        return inst.replace(
            **{"friction.law": self.law},
            **changes,
            tendon_stiffness=stiffness,
            tendon_modulus=None,
            tendon_diameter=None,
            tendon_length=length,
            breaking_load=None,
            handle_range=self.handle_range,
        )


def law_of_both(real_size: ShortForm, scaled_up: ShortForm) -> FrictionLaw:
    """Return the more general friction law of the two instruments."""
    return max(real_size.friction.law, scaled_up.friction.law, key=_LAWS.index)


def friction_of(groups: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    """Return an instrument's groups of friction; those that only the other has get a neutral value."""
    idle = dict(other) | _NEUTRAL
    return {name: groups.get(name, idle.get(name, 0.0)) for name in FRICTION if name in groups or name in other}
