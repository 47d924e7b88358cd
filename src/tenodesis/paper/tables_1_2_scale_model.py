"""Tables I and II: the scale model, its similarity to the instrument, and the care points that come with it."""

from typing import Any

import numpy as np

from tenodesis import statics
from tenodesis.instrument import ShortForm, TendonGear
from tenodesis.paper.context import Context
from tenodesis.paper.published import CAPTION_FORCE, EQUIVALENT_FORCE, SCALE_FACTORS, STATES, STIFFNESS, TIP_FORCE
from tenodesis.report.content import (
    CarePoint,
    Chart,
    Plot,
    ResultColumn,
    Section,
    Table,
    fixed,
    named,
    number,
    unit_text,
)
from tenodesis.similarity import Comparison, JointComparison, compare
from tenodesis.units import in_unit

_CAUSES = 3
"""Number of causes shown of each error."""

_NO_CAUSE = 5e-4
"""Contribution, deg, below which a group does not count as a cause."""

_SHOWN: tuple[tuple[str, str, str, str], ...] = (
    ("stem_diameter", "stem diameter ∅", "mm", "m"),
    ("overall_length", "overall length L", "mm", "m"),
    ("distal_gear_radius", "distal gear radius r", "mm", "m"),
    ("proximal_gear_radius", "proximal gear radius R", "mm", "m"),
    ("distal_pulley_radius", "distal pulley radius r", "mm", "m"),
    ("distal_tendon_offset", "distal tendon offset r", "mm", "m"),
    ("proximal_pulley_radius", "proximal pulley radius R", "mm", "m"),
    ("backbone_length", "backbone length", "mm", "m"),
    ("backbone_rigidity", "backbone rigidity EI", "N*mm^2", "N*m^2"),
    ("end_effector_length", "end-effector length l_d", "mm", "m"),
    ("handle_length", "handle length l_p", "mm", "m"),
    ("tendon_diameter", "tendon diameter d", "mm", "m"),
    ("tendon_modulus", "Young's modulus E", "GPa", "Pa"),
    ("tendon_stiffness", "tendon stiffness k", "N/m", "N/m"),
)


def section(context: Context) -> Section:
    """Compare the instrument with its scale model."""
    scaled = context.scaled
    if scaled is None:
        return Section(
            "similarity",
            "Scale model",
            "<p>No scale model was given; <code>tenodesis bench FILE --scaled-up FILE</code> compares the instrument "
            "with a scale model of the same joint type.</p>",
        )
    comparison = compare(context.inst, scaled)
    makers = (_dimensions, _factors, _groups, _errors, _errors_with_friction, _causes)
    text = (
        "<p>Two instruments of different size lose the same angle if the loss of dexterity Θ is the same. Equal Θ "
        "fixes the factor of force; equal T/kr fixes the factor of tension. Differences in geometry show in the "
        "groups that do not match, and in degrees below, by the full model.</p>"
    )
    tables = [make(context, comparison) for make in makers]
    care = _care_points(context, comparison) if context.is_paper else []
    return Section("similarity", "Scale model", text, [_map(comparison)], tables, care)


def _dimensions(context: Context, comparison: Comparison) -> Table:
    pair = (comparison.real_size, comparison.scaled_up)
    for role, inst in zip(("instrument", "scale_model"), pair, strict=True):
        about = f"Tendon stiffness, {role}"
        context.add(f"table1.stiffness.{role}", inst.tendon_stiffness, "N/m", about, STIFFNESS.get(inst.name))
    rows = []
    for key, name, unit, si_unit in _SHOWN:
        values = [getattr(inst, key) for inst in pair if getattr(inst, key, None) is not None]
        if len(values) < len(pair):
            continue
        shown = [number(value * in_unit(unit, si_unit), 5) for value in values]
        label = f"{name} [{unit_text(unit)}]"
        factor = _factor(context, f"table1.factor.{key}", comparison.factors[key], f"Scale factor of the {name}", key)
        rows.append([label, *shown, *factor])
    printed = [context.results[f"table1.stiffness.{role}"].published for role in ("instrument", "scale_model")]
    beside = " (published: " + " and ".join(f"{each.value:.0f}" for each in printed if each) + " N/m)"
    return Table(
        f"{'D' if context.is_own else 'Table I: d'}esign parameters; k of each instrument follows from E, d and L"
        f"{beside if context.is_paper else ''}",
        ["parameter", *(named(inst) for inst in pair), "factor", *_beside(context)],
        rows,
    )


def _beside(context: Context) -> list[str]:
    """Return the headings of what stands beside a factor."""
    return ["published", "residual"] if context.is_paper else []


def _factor(context: Context, key: str, value: float, description: str, published: str = "") -> tuple[str, ...]:
    """Record a factor as a result; return it as text, in the paper's report with the published factor and residual."""
    context.add(key, value, "1", description, SCALE_FACTORS.get(published))
    result = context.results[key]
    if not context.is_paper:
        return (fixed(value, 4),)
    if result.published is None or result.residual is None:
        return fixed(value, 4), "", ""
    return fixed(value, 4), number(result.published.value, 5), f"{result.residual:+.4f}".replace("-", "−")


def _factors(context: Context, comparison: Comparison) -> Table:
    title = "Scale factors" if context.is_own else "Table II: scale factors"
    table = Table(title, ["variable", "factor", *_beside(context)], [])
    angles = {f"{np.degrees(angle):.4g}": angle for angle in np.array([0.0, 0.5, 1.0]) * context.inst.output_range}
    low, middle, high = angles
    force = float(comparison.force_factor(angles[middle]))

    def add(shown: str, key: str, value: Any, about: str, published: str = "") -> None:
        table.rows.append([shown, *_factor(context, f"table2.{key}", float(value), about, published)])

    for at, angle in angles.items():
        about = f"Factor of force for equal loss of dexterity at {at} deg"
        published = "force" if at == middle else ""
        add(f"force for equal Θ at {at}°", f"force_factor.at_{at}deg", comparison.force_factor(angle), about, published)
    add("tendon tension", "tension_factor", comparison.tension_factor, "Factor of tendon tension", "tension")
    for at in (low, high):
        stiffer, about = comparison.flexural_stiffness_factor(angles[at]), f"Factor of flexural stiffness at {at} deg"
        add(f"flexural stiffness κ_θ at {at}°", f"flexural_stiffness_factor.at_{at}deg", stiffer, about)
    for at, angle in angles.items():
        large = statics.loss_of_dexterity(comparison.scaled_up, angle, force)
        lost = large / statics.loss_of_dexterity(comparison.real_size, angle, 1.0)
        about = f"Factor of Θ at {at} deg with the mid-range force factor"
        add(f"loss of dexterity Θ at {at}°", f"loss_factor.at_{at}deg", lost, about, "loss_of_dexterity")
    return table


def _groups(context: Context, comparison: Comparison) -> Table:
    return groups(
        context,
        comparison,
        f"Dimensionless groups; F is {comparison.largest_force:g} N times the force factor, T_o as in the files. The "
        "factors of force and time are those that make Theta and J/(kappa t^2) equal",
    )


def groups(context: Context, pair: Comparison | JointComparison, caption: str) -> Table:
    """Return the dimensionless groups of both instruments."""

    def column(heading: str, name: str, about: str, **look: Any) -> ResultColumn:
        about = f"Dimensionless group {{group}}, {about}"
        return ResultColumn(heading, f"groups.{{group}}.{name}", "1", about, **look)

    table = context.table(
        caption,
        "group",
        "",
        column(named(pair.real_size), "instrument", "instrument", form=_five_digits),
        column(named(pair.scaled_up), "scale_model", "scale model", form=_five_digits),
        column("ratio", "ratio", "ratio of the two", digits=4),
        "",
    )
    for group in pair.groups:
        judged = "made equal" if group.imposed else "matches" if group.matches else "differs"
        values = (group.real_size, group.scaled_up, group.ratio)
        table.row(group.name, group.meaning, *values, judged, group=group.name)
    return table


def _five_digits(value: float) -> str:
    return number(value, 5)


def _errors(context: Context, comparison: Comparison) -> Table:
    reach = np.degrees(context.inst.output_range)

    def column(heading: str, name: str, about: str, **look: Any) -> ResultColumn:
        return ResultColumn(
            heading, f"similarity.{{name}}.to_{{limit:g}}N.{name}", "deg", f"{about}, {{about}}", **look
        )

    table = context.table(
        f"Similarity error: output of {named(comparison.scaled_up)} minus {named(comparison.real_size)} [°] over "
        f"−{reach:.0f} … {reach:.0f}° of unloaded output",
        "pretension scaled-up",
        f"force on {named(comparison.real_size)}",
        column("rms", "rms", "Root mean square similarity error", digits=3),
        column("95 %", "quantile_95", "95 % quantile of the similarity error", digits=3),
        column("largest", "largest", "Largest similarity error", digits=3),
        "largest at",
        "no equilibrium",
    )
    limits = [comparison.largest_force]
    if context.is_paper and comparison.largest_force > EQUIVALENT_FORCE.value:
        limits.insert(0, EQUIVALENT_FORCE.value)
    for name, full in comparison.errors.items():
        for limit in limits:
            error = comparison.error(pretension=full.scaled_up_pretension, largest_force=limit)
            key = f"similarity.{name.replace(' ', '_')}.to_{limit:g}N"
            about = f"pretension {name} ({error.scaled_up_pretension:.4g} N), forces to {limit:g} N"
            context.add(f"{key}.unsolved", error.unsolved, "1", f"Share of points without equilibrium, {about}")
            angle, force = error.worst
            context.add(f"{key}.worst_handle", np.degrees(angle), "deg", f"Handle angle of the largest error, {about}")
            context.add(f"{key}.worst_force", force, "N", f"Force of the largest error, {about}")
            table.row(
                f"{error.scaled_up_pretension:.4g} N ({name})",
                f"0 … {limit:g} N",
                error.rms,
                error.quantile_95,
                error.largest,
                f"θ_h = {fixed(np.degrees(angle), 1)}°, {force:.2f} N",
                f"{100 * error.unsolved:.1f} %",
                name=name.replace(" ", "_"),
                limit=limit,
                about=about,
            )
    return table


def _errors_with_friction(context: Context, comparison: Comparison) -> Table:
    """Errors at rest and in time, over loops of the handle through the working range."""

    def column(heading: str, name: str, about: str) -> ResultColumn:
        return ResultColumn(heading, f"similarity_with_friction.{{key}}.{name}", "deg", f"{about} {{about}}", digits=3)

    table = context.table(
        "Similarity error with friction [°], over loops of the handle through the working range under constant forces: "
        "at rest after every step, and in time on the twin, both with the parameters of their files. At the largest "
        "load that both hold, single jumps of a tip determine the largest error",
        "pretension scaled-up",
        f"force on {named(comparison.real_size)}",
        "",
        column("rms", "rms", "Root mean square similarity error"),
        column("95 %", "quantile_95", "95 % quantile of similarity error"),
        column("largest", "largest", "Largest similarity error"),
        "largest at",
    )
    sets: dict[str, tuple[list[float] | None, str]] = {"held": (None, "loads up to the largest that both hold")}
    if context.is_paper:
        factor = float(comparison.force_factor())
        loads = [force / factor for force in comparison.scaled_up.conditions.forces]
        sets = {"fig14": (loads, "the loads of Fig. 14")} | sets
    for name, pretension in (("scaled", None), ("as used", comparison.scaled_up.pretension)):
        for which, (forces, described) in sets.items():
            for kind, measure in (("at rest", comparison.error_at_rest), ("in time", comparison.cycle_error)):
                error = measure(pretension=pretension, forces=forces)
                if np.isnan(error.largest):
                    continue
                at = error.worst
                table.row(
                    f"{error.scaled_up_pretension:.4g} N ({name})",
                    f"to {error.force.max():.3g} N",
                    kind,
                    error.rms,
                    error.quantile_95,
                    error.largest,
                    f"θ_h = {fixed(np.degrees(at.handle_angle), 1)}°, {at.force:.2f} N, "
                    f"{'flexing' if at.flexing else 'extending'}",
                    key=f"{name}.{which}.{kind}".replace(" ", "_"),
                    about=f"with friction {kind}, pretension {name}, {described}",
                )
    return table


def _causes(context: Context, comparison: Comparison) -> Table:
    """Which group's mismatch causes the error, without friction and with it."""
    limit = EQUIVALENT_FORCE.value if context.is_paper else None
    key, about = "causes.{name}.{kind}_friction.{group}", "that {group} causes, {kind} friction, pretension {shown}"
    to = "" if limit is None else f", loads up to {limit:g} N"
    table = context.table(
        f"Causes of the error: the groups with the largest effect, each varied alone{to} [°]",
        "pretension",
        "group",
        ResultColumn(named(comparison.real_size), form=number),
        ResultColumn(named(comparison.scaled_up), form=number),
        ResultColumn(
            "where largest", f"{key}.at_worst", "deg", f"Similarity error where it is largest {about}", digits=3
        ),
        ResultColumn("rms", f"{key}.rms", "deg", f"Root mean square similarity error {about}", digits=3),
        "of",
    )
    forces = None if limit is None else [limit * share for share in (0.0, 0.5, 1.0)]
    for name, pretension in (("scaled", None), ("as used", comparison.scaled_up.pretension)):
        for kind, options in (("without", {"largest_force": limit}), ("with", {"friction": True, "forces": forces})):
            try:
                causes = comparison.causes(pretension=pretension, **options)
            except ValueError:
                # There is no load that both hold, and so no error to explain.
                continue
            for cause in causes.causes[:_CAUSES]:
                if not abs(cause.at_worst) > _NO_CAUSE:
                    continue
                table.row(
                    f"{name}, {kind} friction",
                    cause.name,
                    cause.real_size,
                    cause.scaled_up,
                    cause.at_worst,
                    cause.rms,
                    f"{fixed(causes.error, 3)} / {fixed(causes.error_rms, 3)}",
                    name=name.replace(" ", "_"),
                    shown=name,
                    kind=kind,
                    group=cause.name,
                )
    return table


def _map(comparison: Comparison) -> Plot:
    chart, axes = Chart.panels(2, width=8.6, height=3.7)
    bound = max(0.5, *(min(5.0, error.quantile_95) for error in comparison.errors.values()))
    for axis, (name, error) in zip(axes, comparison.errors.items(), strict=True):
        degrees = np.degrees(error.handle_angle)
        mesh = axis.pcolormesh(
            degrees, error.force, error.error.T, cmap="RdBu_r", vmin=-bound, vmax=bound,
            shading="gouraud", rasterized=True,
        )  # fmt: skip
        axis.set_facecolor("#d5dae0")
        axis.grid(visible=False)
        axis.set(
            title=f"T$_o$ = {error.scaled_up_pretension:.3g} N ({name})",
            xlabel="handle angle $\\theta_h$ [deg]",
            ylabel="force on the instrument [N]",
        )
        handle, force = np.meshgrid(degrees, error.force, indexing="ij")
        chart.keep("handle_angle [deg]", handle.ravel())
        chart.keep("force [N]", force.ravel())
        chart.keep(f"error, pretension {name} [deg]", error.error.ravel())
    chart.figure.colorbar(mesh, ax=axes, label="error [deg]", extend="both")
    return chart.plot(
        "similarity_error",
        f"Similarity error: output of {named(comparison.scaled_up)} minus {named(comparison.real_size)}, force factor "
        f"{comparison.force_factor():.3f}; the colour scale ends at ±{bound:.2g}°. Grey: no equilibrium.",
    )


def _care_points(context: Context, comparison: Comparison) -> list[CarePoint]:
    """Return the care points that come with the scale model: 4 to 8."""
    return [
        _one_angle(context, comparison),
        _pretension(context, comparison),
        _pairs(context, comparison.scaled_up),
        _cable(context, comparison),
        _stiffness(context, comparison),
    ]


def _one_angle(context: Context, comparison: Comparison) -> CarePoint:
    at = [context.results[f"table2.force_factor.at_{angle}deg"].value for angle in (0, 40, 80)]
    slenderness = next(group for group in comparison.groups if group.name == "l_d/r")
    return CarePoint(
        4,
        "Similarity is exact at one angle only",
        f"l_d/r differs ({number(slenderness.real_size, 3)} against {number(slenderness.scaled_up, 3)}), so the force "
        f"factor for equal Θ runs from {fixed(at[0], 3)} at 0° over {fixed(at[1], 3)} at 40° to "
        f"{fixed(at[2], 3)} at 80°; the table's 2.88 is mid-range.",
    )


def _pretension(context: Context, comparison: Comparison) -> CarePoint:
    scaled = context.add(
        "care.5.scaled_pretension",
        comparison.real_size.pretension * comparison.tension_factor,
        "N",
        "Pretension of the scaled-up instrument that is similar to the real-size instrument's",
    )
    small, large = (
        float(statics.slack_force(inst, inst.output_range)) for inst in (comparison.real_size, comparison.scaled_up)
    )
    meant = large / float(comparison.force_factor())
    context.add("care.5.slack_force.real", small, "N", "Force at slack onset at 80 deg, real-size")
    context.add(
        "care.5.slack_force.as_used",
        meant,
        "N",
        "Force at slack onset at 80 deg, scaled-up with a pretension of 25 N, scaled down",
    )
    used, similar = comparison.errors["as used"], comparison.errors["scaled"]
    return CarePoint(
        5,
        "Pretension must scale too",
        f"{comparison.real_size.pretension:g} N on the real-size instrument is {fixed(scaled, 1)} N on the scaled-up "
        f"one; the experiments used {comparison.scaled_up.pretension:g} N. Slack then begins at 80° at "
        f"{fixed(meant)} N, scaled down, instead of {fixed(small)} N, and the rms similarity error up to "
        f"{comparison.largest_force:g} N grows from {fixed(similar.rms, 2)}° to {fixed(used.rms, 2)}°. Up to "
        f"{EQUIVALENT_FORCE.value} N, where Fig. 14 was taken, no tendon goes slack and without friction the "
        "pretension makes no difference; with friction, which grows with tension, it does even there.",
    )


def _pairs(context: Context, scaled: ShortForm) -> CarePoint:
    sentences = []
    for handle, output in STATES[1:]:
        follows = float(np.degrees(statics.output_angle(scaled, np.radians(handle.value))))
        needs = float(np.degrees(statics.handle_angle(scaled, np.radians(output.value))))
        key = f"care.6.at_{output.value:.4g}deg"
        context.add(
            f"{key}.output", follows, "deg", f"Output at the published handle angle {handle.value:g} deg", output
        )
        context.add(f"{key}.handle", needs, "deg", f"Handle angle that gives {output.value:g} deg", handle)
        sentences.append(
            f"{handle.value:g}° → {output.value:g}° published, {fixed(follows, 1)}° by eq. 18; "
            f"{output.value:g}° needs {fixed(needs, 1)}°"
        )
    return CarePoint(
        6,
        "The angle pairs of Fig. 15 contradict eq. 18",
        f"{'. '.join(sentences)}. We reproduce the four states by output angle.",
    )


def _cable(context: Context, comparison: Comparison) -> CarePoint:
    conditions = comparison.scaled_up.conditions
    moment = float(conditions.cable_force or 0) * float(conditions.cable_pulley_radius or 0)
    assert isinstance(comparison.scaled_up, TendonGear)
    lever = comparison.scaled_up.end_effector_length + 2 * comparison.scaled_up.distal_gear_radius
    tip = context.add(
        "care.7.tip_force", moment / lever, "N", "Force at the scaled-up tip from 10 N on a cable", TIP_FORCE
    )
    factor = float(comparison.force_factor())
    real = context.add(
        "care.7.real_force", TIP_FORCE.value / factor, "N", "Real-size force that 1.5 N stands for", EQUIVALENT_FORCE
    )
    return CarePoint(
        7,
        "10 N on a weight cable are not 1.5 N on the real-size instrument",
        f"10 N on the cable at {1e3 * float(conditions.cable_pulley_radius or 0):g} mm are {fixed(moment)} N·m, and "
        f"with the lever l_d + 2r = {1e3 * lever:.0f} mm {fixed(tip)} N at the scaled-up tip (published: "
        f"{TIP_FORCE.value} N), and 1.5 N there stand for {fixed(real)} N on the real-size instrument (published: "
        f"{EQUIVALENT_FORCE.value} N). The {CAPTION_FORCE.source} says {CAPTION_FORCE.value} N; the text is right.",
    )


def _stiffness(context: Context, comparison: Comparison) -> CarePoint:
    small, large = (inst.tendon_stiffness for inst in (comparison.real_size, comparison.scaled_up))
    return CarePoint(
        8,
        "Table I's stiffnesses follow from E A / L",
        f"With L the overall length they come out at {small:.0f} and {large:.0f} N/m (published: 31172 and 11451); the "
        "files give diameter, modulus and length, not stiffness.",
    )
