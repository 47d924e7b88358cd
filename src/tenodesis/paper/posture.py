"""The instrument as its file lists it: joints, tendons and their routes, and its posture in space."""

import numpy as np

from tenodesis import kinematics, statics
from tenodesis.instrument import FullForm, in_arcs
from tenodesis.paper.context import Context
from tenodesis.paper.subject import HeldState
from tenodesis.report import routing, space
from tenodesis.report.content import Plot, Section, Table, named


def section(context: Context) -> Section:
    """Draw routes and postures, and list joints and tendons, a backbone's arcs as one joint."""
    inst = in_arcs(context.whole, 1)
    text = (
        "<p>Angles are about the axes named; yaw bends the tip toward x, pitch toward y, z points along the stem. All "
        "chapters that follow go by these joints and tendons.</p>"
    )
    arms = {
        f"arm of {joint.name} [mm]": 1e3 * column
        for joint, column in zip(inst.tip_joints, statics.straight_arms(inst).T, strict=True)
    }
    routes = Plot("routing", f"Routes of the tendons from handle to tip, {named(inst)}.", routing.draw(inst), arms)
    plots = [routes, *(_posture(context, state) for state in context.subject.states[-1:])]
    return Section("posture", "Joints, tendons and posture", text, plots, [_joints(inst), _tendons(inst)])


def _posture(context: Context, state: HeldState) -> Plot:
    inst = context.whole
    figure = space.draw(inst, state.angles, state.handle)
    paths = kinematics.frames(inst, state.angles, state.handle).tendons
    curves = {
        f"{name} {axis} [mm]": 1e3 * np.asarray(path)[:, n]
        for name, path in paths.items()
        for n, axis in enumerate("xyz")
    }
    return Plot("posture", f"{named(inst)} at {context.subject.described(state)}.", figure, curves)


def _joints(inst: FullForm) -> Table:
    tips = inst.tip_joints
    on = {joint.name: "stem" if at < 0 else tips[at].name for joint, at in zip(tips, inst.parents, strict=True)}
    rows = [
        [
            joint.name,
            joint.place,
            on.get(joint.name, joint.on or "–"),
            joint.mechanism,
            joint.axis if isinstance(joint.axis, str) else " ".join(f"{value:.3g}" for value in joint.axis_vector),
            f"{1e3 * joint.radius:.4g}",
            joint.range_text,
        ]
        for joint in inst.joints
    ]
    return Table("Joints", ["joint", "at", "stands on", "mechanism", "axis", "radius [mm]", "range [°]"], rows)


def _tendons(inst: FullForm) -> Table:
    rows = [
        [tendon.name, tendon.start, " → ".join(f"{one.joint} {one.side}" for one in tendon.route),
         f"{1e-3 * stiffness:.4g}", f"{tension:.4g}"]
        for tendon, stiffness, tension in zip(inst.tendons, inst.stiffnesses, inst.pretensions, strict=True)
    ]  # fmt: skip
    return Table("Tendons", ["tendon", "begins at", "route", "stiffness [N/mm]", "pretension [N]"], rows)
