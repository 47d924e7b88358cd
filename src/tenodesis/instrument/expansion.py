"""The short form of an instrument written out as joints and tendons."""

from typing import TYPE_CHECKING, Any

from tenodesis.errors import InstrumentError
from tenodesis.instrument.compliance import compliance_shares
from tenodesis.instrument.full_form import FullForm
from tenodesis.instrument.hardware import Hand
from tenodesis.instrument.instrument import ENTRIES
from tenodesis.instrument.lengths import lengths
from tenodesis.instrument.tip_motion import tip_damping, tip_inertia
from tenodesis.toml import validated

if TYPE_CHECKING:
    from tenodesis.instrument.short_form import ShortForm

_MECHANISMS = {"tendon-gear": "tendon-gear", "tendon-pulley": "pulley", "continuum": "continuum"}


def expand(inst: "ShortForm") -> FullForm:
    """Return an instrument in the short form as joints and tendons.

    Raises
    ------
    InstrumentError
        Nothing is left for the stem.
    """
    along = lengths(inst)
    joints: list[dict[str, Any]] = []
    for place, radii in (("handle", along.proximal_radii), ("tip", along.distal_radii)):
        for i, (axis, planar) in enumerate(zip(inst.axes, inst.planar, strict=True)):
            at_tip, is_last = place == "tip", i == len(inst.axes) - 1
            mechanism = _MECHANISMS[inst.joint_type]
            joint = {
                "name": axis if at_tip else f"handle_{axis}",
                "place": place,
                "mechanism": "pulley" if mechanism == "continuum" and not at_tip else mechanism,
                "axis": axis,
                "radius": radii[i],
                "range": planar.output_range if at_tip else planar.handle_range,
                "offset": 0.0 if i == 0 else along.joint_spacing if at_tip else along.handle_joint_spacing,
            }
            if joint["mechanism"] == "continuum":
                joint |= {"backbone_length": planar.backbone_length, "backbone_rigidity": planar.backbone_rigidity}
                joint["arcs"] = 1
            if at_tip:
                motion = {"inertia": tip_inertia(planar), "damping": tip_damping(planar), "stop": planar.output_stop}
                joint |= motion
            if is_last:
                joint["end_effector_length"] = along.end_effector_length if at_tip else along.handle_length
            joints.append(joint)
    tendons = []
    for i, (axis, planar) in enumerate(zip(inst.axes, inst.planar, strict=True)):
        for side in ("agonist", "antagonist"):
            passed = [{"joint": f"handle_{other}", "side": "middle"} for other in reversed(inst.axes[:i])]
            beyond = [{"joint": other, "side": "middle"} for other in inst.axes[:i]]
            # A handle's tendon starts at its own joint and passes those that stand nearer to the stem.
            route = [{"joint": f"handle_{axis}", "side": side}, *passed, *beyond, {"joint": axis, "side": side}]
            wrapped = [crossing | {"guide_wrap": inst.friction.base_wrap} for crossing in route]
            tendon = {"name": f"{axis}_{side}", "route": wrapped, "stiffness": planar.tendon_stiffness}
            tendons.append(tendon | {"pretension": planar.pretension})
    values = {
        "name": inst.name,
        "description": inst.description,
        "stem_length": along.stem_length,
        "stem_diameter": along.stem_diameter,
        "pretension": inst.pretension,
        "joints": joints,
        "tendons": tendons,
    }
    values |= {
        table: getattr(inst, table).model_dump(exclude_unset=True, exclude_none=True)
        for table in ("conditions", "drives", "sensors", "control")
    }
    values["dynamics"] = {name: getattr(inst.dynamics, name) for name in Hand.model_fields}
    shares = compliance_shares(inst.planar[0])
    values["friction"] = inst.friction.model_dump(exclude_none=True) | {
        "base_wrap": 0.0,
        "handle_compliance_share": shares.handle,
        "handle_joint_compliance_share": shares.handle_joint,
        "tip_joint_compliance_share": shares.tip_joint,
    }
    if inst.breaking_load is not None:
        values["breaking_load"] = inst.breaking_load
    return validated(FullForm, values, InstrumentError, inst.name, context={"expanded": True}, entries=ENTRIES)
