"""A sudden load on the held instrument with the robust law: what every compensated joint gets back."""

import numpy as np

from tenodesis import control
from tenodesis.control import Controller
from tenodesis.instrument import Instrument
from tenodesis.paper.any_instrument.held import Load, described, loads, panels, states
from tenodesis.paper.any_instrument.step_load import Response, respond
from tenodesis.paper.context import Context
from tenodesis.report import style
from tenodesis.report.content import Array, Column, Plot, Section, named
from tenodesis.simulate import campaign
from tenodesis.statics import chain

AFTER = 7.0
"""Time under the load, s."""
JUDGED = 0.5
"""Time at the end over which errors are taken, s."""
LAWS = {"off": "motors off", "robust": "robust law"}


def section(context: Context) -> Section:
    """Compute the step loads with the motors off and with the robust law."""
    inst = context.whole
    state = states(inst)[-1]
    made_for = control.compensated(inst)

    def trial(load: Load, law: str) -> dict[str, Response] | None:
        done = respond(inst, state, load, controller=controller_of(made_for, law), after=AFTER)
        return None if done is None else {"done": done}

    across = [load for load in loads(inst) if load.wrench.any()]
    rows = campaign.run(trial, campaign.cases(load=across, law=LAWS), on="threads")
    found = {(row["load"].name, row["law"]): row["done"] for row in rows}
    title = "Compensation on the twin"
    if not found:
        return Section("compensated", title, f"<p>Not run: {named(inst)} holds none of the loads on the twin.</p>")
    joints = [pair.joint for pair in control.pairs(inst).values()]
    names = [inst.tip_joints[joint].name for joint in joints]
    table = context.table(
        f"Error against the unloaded angle without friction, mean of the last {JUDGED:g} s",
        "load",
        "law",
        *(
            Column(
                f"{name} [°]",
                f"compensated.{{law}}.final_error.{name}.{{load}}",
                "deg",
                f"Error of {name} after a step load of {{words}}, {{law}}",
            )
            for name in names
        ),
        "faults",
    )
    worst = 0.0
    for (load_name, law), done in found.items():
        final = _error(context, done, joints)[-round(JUDGED / np.diff(done.run.time[:2])[0]) :].mean(axis=0)
        worst = max(worst, float(np.abs(final).max())) if law == "robust" else worst
        said = ", ".join(done.recorded.run.fault_times) or "none"
        table.row(
            done.load.text(), LAWS[law], *map(float, final), said, law=law, load=load_name, words=done.load.text()
        )
    context.add("compensated.robust.worst", worst, "deg", "Largest final error of a compensated joint, robust law")
    others = [joint.name for joint in inst.tip_joints if joint.name not in names]
    text = (
        f"<p>As above, {described(inst, state)}, with the controller enabled on the joints that have a pair of tendons "
        f"of their own: {' and '.join(names)}. It knows tensions, spool and handle angles, not the tip."
        + (f" Not compensated: {', '.join(others)}." if others else "")
        + "</p>"
    )
    return Section("compensated", title, text, [_plot(context, found, joints)], [table])


def controller_of(inst: Instrument, law: str) -> Controller | None:
    """Return the controller of a law; None where the motors are off."""
    return Controller(inst, law="robust", enabled=True) if law == "robust" else None


def _error(context: Context, done: Response, joints: list[int]) -> Array:
    """Return how far joints are from where they would be without load and friction, (n, joints), deg."""
    aims = chain.output_angles(context.whole, done.run.by_column("handle_angle"))
    return np.degrees(done.run.by_column("output_angle") - aims)[:, joints]


def _plot(context: Context, found: dict[tuple[str, str], Response], joints: list[int]) -> Plot:
    inst = context.whole
    names = list(dict.fromkeys(load for load, _ in found))
    chart, axes = panels(len(names), 2.8)
    panel_of = dict(zip(names, axes, strict=True))
    colors = style.colors(len(joints) + 1)[1:]
    for (load, law), done in found.items():
        time = chart.keep(f"time, {load}, {law} [s]", done.run.time - done.run.time[0])
        errors = _error(context, done, joints)
        for joint, color, error in zip(joints, colors, errors.T, strict=True):
            line = "-" if law == "robust" else "--"
            heading = f"error of {inst.tip_joints[joint].name}, {load}, {law} [deg]"
            chart.curve(panel_of[load], time, heading, error, line, color=color, lw=1.3)
        panel_of[load].set(title=done.load.text(), xlabel="time [s]", xlim=(time[0], time[-1]))
    axes[0].set_ylabel("off the unloaded angle [deg]")
    lines = [(inst.tip_joints[joint].name, color, "-") for joint, color in zip(joints, colors, strict=True)]
    style.legend_outside(chart.figure, *lines, ("robust law", style.MUTED, "-"), ("motors off", style.MUTED, "--"))
    return chart.plot("compensated", f"Error of the compensated joints when a load comes, {named(inst)}.")
