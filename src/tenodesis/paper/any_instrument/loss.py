"""What loads take from every joint of an instrument that is held, and what gives it back."""

import numpy as np

from tenodesis import statics
from tenodesis.paper.any_instrument.held import Load, State, described, legend, loads, looks, panels, states
from tenodesis.paper.context import Context
from tenodesis.report import style
from tenodesis.report.content import Column, Plot, Section, Table, fixed, named
from tenodesis.statics import Loss, chain

_POINTS = 41


def section(context: Context) -> Section:
    """Compute the loss of every joint under loads in the directions that matter, and the strokes that restore it."""
    inst = context.whole
    held, applied = states(inst), loads(inst)
    names = [joint.name for joint in inst.tip_joints]
    tables: list[Table] = []
    largest = 0.0
    for state in held:
        key = f"{{joint}}.{state.name}.{{load}}.{{size:.3g}}N"
        restored = "strokes that bring all joints back"
        table = context.table(
            f"Lost at {described(inst, state)}: the unloaded minus the loaded angle; {restored}, largest and by tendon",
            "load",
            *(
                Column(
                    f"{name} [°]",
                    "loss." + key.replace("{joint}", name),
                    "deg",
                    f"Angle that {{size:.3g}} N {{direction}} take from {name}, {state.name}",
                    optional=True,
                )
                for name in names
            ),
            Column(
                "largest stroke [mm]",
                "loss.stroke." + key.removeprefix("{joint}."),
                "mm",
                f"Largest stroke that brings all joints back under {{size:.3g}} N {{direction}}, {state.name}",
                digits=3,
                optional=True,
            ),
            "strokes [mm]",
        )
        for load in applied:
            for multiple in load.multiples:
                lost = _loss(context, state, load, multiple)
                size = multiple * load.size
                wound = 1e3 * lost.strokes
                moved = [(t.name, s) for t, s in zip(inst.tendons, wound, strict=True) if abs(s) > 1e-4]
                table.row(
                    load.text(multiple),
                    *np.degrees(lost.lost),
                    float(np.abs(wound).max()),
                    ", ".join(f"{name} {fixed(stroke)}" for name, stroke in moved) or "–",
                    load=load.name,
                    size=size,
                    direction=load.direction,
                )
                if multiple == 1.0 and np.isfinite(lost.lost).all():
                    largest = max(largest, float(np.degrees(np.abs(lost.lost)).max()))
        tables.append(table)
    shown = " or ".join(load.text() for load in applied)
    context.add("loss.largest", largest, "deg", f"Largest angle that a joint loses under {shown}")
    text = (
        "<p>Handle and motors are held, without friction. Forces act at the tip along its own axes: z along it, x "
        "where positive yaw bends, y where positive pitch does; each is taken against flexion. Grip presses the "
        "jaws apart. Directions that take next to nothing from every joint are left out. A dash: "
        "the tip cannot be held, or motors cannot restore it.</p>"
    )
    return Section("loss", "Loss of output angle", text, [_plot(context, held, applied)], tables)


def _loss(context: Context, state: State, load: Load, multiple: float) -> Loss:
    return statics.loss(context.whole, state.angles, multiple * load.wrench, multiple * load.grip)


def _plot(context: Context, held: list[State], applied: list[Load]) -> Plot:
    inst = context.whole
    chart, axes = panels(len(applied))
    for axis, load in zip(axes, applied, strict=True):
        multiples = np.linspace(0.0, load.multiples[-1], _POINTS)
        forces = chart.keep(f"force {load.direction} [N]", multiples * load.size)
        for state, line in zip(held, ("--", "-")[-len(held) :], strict=True):
            free = chain.output_angles(inst, state.handle, strokes=state.strokes)
            wrench, grip = np.outer(multiples, load.wrench), multiples * load.grip
            angles = chain.output_angles(inst, state.handle, wrench, grip_force=grip, strokes=state.strokes)
            for n, (name, look) in enumerate(looks(inst).items()):
                at = f"{name}, {state.name}, {load.direction} [deg]"
                chart.curve(axis, forces, f"lost by {at}", np.degrees((free - angles)[:, n]), line, **look)
        # At the straight tip a slack tendon may tighten at once, and the rates there hold for no load.
        rates = chain.rates(inst, held[-1].handle, strokes=held[-1].strokes)
        first = -np.degrees(np.outer(multiples, rates.by_wrench @ load.wrench + rates.by_grip * load.grip))
        for (name, color, _), lost in zip(legend(inst), first.T, strict=True):
            chart.curve(axis, forces, f"first order of {name}, {load.direction} [deg]", lost, ":", color=color, lw=1.0)
        axis.set(title=load.direction, xlabel="force [N]", xlim=(0, forces[-1]))
    axes[0].set_ylabel("lost [deg]")
    lines = [("straight", style.MUTED, "--")] * (len(held) > 1) + [("first order", style.MUTED, ":")]
    style.legend_outside(chart.figure, *legend(inst), *lines)
    bent = described(inst, held[-1])
    return chart.plot("loss", f"Loss of every joint over the load, {named(inst)} at {bent} (solid), and first order.")
