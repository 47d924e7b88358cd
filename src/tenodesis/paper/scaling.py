"""Tables I and II: the scale model, what it keeps of the instrument, and what it does not."""

from typing import Any

import numpy as np

from tenodesis import statics
from tenodesis.paper.context import Context
from tenodesis.paper.published import EQUIVALENT_FORCE, SCALE_FACTORS, STIFFNESS
from tenodesis.paper.scaling_care import care_points
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named, number
from tenodesis.similarity import Comparison, SimilarityError, compare
from tenodesis.units import in_unit

_CAUSES = 3
"""Causes that are shown of each error."""

_NO_CAUSE = 5e-4
"""Contribution, deg, below which a group causes nothing."""

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
            "with one of the same joint type.</p>",
        )
    comparison = compare(context.inst, scaled)
    tables = [_dimensions(context, comparison), _factors(context, comparison), _groups(context, comparison)]
    tables.append(_errors(context, comparison))
    tables += [_with_friction(context, comparison), _causes(context, comparison)]
    text = (
        "<p>Two instruments of different size lose the same angle if the loss of dexterity Θ is the same. Equal Θ "
        "fixes one factor for force; equal T/kr fixes one for tension. What the geometry does not share shows in the "
        "groups that do not match, and in degrees below, by the full model.</p>"
    )
    care = care_points(context, comparison) if context.is_paper else []
    return Section("similarity", "Scale model", text, [_map(comparison)], tables, care)


def _dimensions(context: Context, comparison: Comparison) -> Table:
    rows = []
    for key, name, unit, si_unit in _SHOWN:
        model, prototype = (getattr(inst, key, None) for inst in (comparison.real_size, comparison.scaled_up))
        if model is None or prototype is None:
            continue
        factor = comparison.factors[key]
        printed = SCALE_FACTORS.get(key)
        context.add(f"table1.factor.{key}", factor, "1", f"Scale factor of the {name}", printed)
        shown = [number(value * in_unit(unit, si_unit), 5) for value in (model, prototype)]
        label = unit.replace("*", "·").replace("^2", "²")
        rows.append([f"{name} [{label}]", *shown, *_beside(context, f"table1.factor.{key}")])
    for role, inst in (("instrument", comparison.real_size), ("scale_model", comparison.scaled_up)):
        printed = STIFFNESS.get(inst.name)
        context.add(
            f"table1.stiffness.{role}",
            inst.tendon_stiffness,
            "N/m",
            f"Tendon stiffness, {role}",
            printed,
        )
    return Table(
        f"Table I: design parameters; k of each instrument follows from E, d and L{_printed_stiffness(context)}",
        ["parameter", named(comparison.real_size), named(comparison.scaled_up), "factor", "published", "residual"],
        rows,
    )


def _printed_stiffness(context: Context) -> str:
    if not context.is_paper:
        return ""
    pairs = [context.results[f"table1.stiffness.{role}"] for role in ("instrument", "scale_model")]
    return " (published: " + " and ".join(f"{row.published.value:.0f}" for row in pairs if row.published) + " N/m)"


def _factors(context: Context, comparison: Comparison) -> Table:
    low, middle, high = (context.inst.output_range * share for share in (0.0, 0.5, 1.0))
    forces = {angle: float(comparison.force_factor(angle)) for angle in (low, middle, high)}
    stiffness = {angle: float(comparison.flexural_stiffness_factor(angle)) for angle in (low, high)}
    rows = []
    for angle, value in forces.items():
        key = f"table2.force_factor.at_{np.degrees(angle):.4g}deg"
        printed = SCALE_FACTORS["force"] if angle == middle else None
        context.add(
            key,
            value,
            "1",
            f"Factor of force for equal loss of dexterity at {np.degrees(angle):.4g} deg",
            printed,
        )
        rows.append([f"force for equal Θ at {np.degrees(angle):.4g}°", *_beside(context, key)])
    context.add(
        "table2.tension_factor",
        comparison.tension_factor,
        "1",
        "Factor of tendon tension",
        SCALE_FACTORS["tension"],
    )
    rows.append(["tendon tension", *_beside(context, "table2.tension_factor")])
    for angle, value in stiffness.items():
        key = f"table2.flexural_stiffness_factor.at_{np.degrees(angle):.4g}deg"
        context.add(key, value, "1", f"Factor of flexural stiffness at {np.degrees(angle):.4g} deg")
        rows.append([f"flexural stiffness κ_θ at {np.degrees(angle):.4g}°", *_beside(context, key)])
    for angle in (low, middle, high):
        ratio = (
            statics.loss_of_dexterity(comparison.scaled_up, angle, forces[middle])
            / statics.loss_of_dexterity(comparison.real_size, angle, 1.0)
        )  # fmt: skip
        key = f"table2.loss_factor.at_{np.degrees(angle):.4g}deg"
        context.add(
            key,
            ratio,
            "1",
            f"Factor of Θ at {np.degrees(angle):.4g} deg with the mid-range force factor",
            SCALE_FACTORS["loss_of_dexterity"],
        )
        rows.append([f"loss of dexterity Θ at {np.degrees(angle):.4g}°", *_beside(context, key)])
    return Table("Table II: scale factors", ["variable", "factor", "published", "residual"], rows)


def _beside(context: Context, key: str) -> tuple[str, str, str]:
    """Return our factor, the published one and the residual, as text."""
    result = context.results[key]
    if result.published is None or result.residual is None:
        return fixed(result.value, 4), "", ""
    return (
        fixed(result.value, 4),
        number(result.published.value, 5),
        f"{result.residual:+.4f}".replace("-", "−"),
    )


def _groups(context: Context, comparison: Comparison) -> Table:
    for group in comparison.groups:
        about = f"Dimensionless group {group.name}"
        context.add(f"groups.{group.name}.instrument", group.real_size, "1", f"{about}, instrument")
        context.add(f"groups.{group.name}.scale_model", group.scaled_up, "1", f"{about}, scale model")
        context.add(f"groups.{group.name}.ratio", group.ratio, "1", f"{about}, ratio of the two")
    rows = [
        [
            g.name,
            number(g.real_size, 5),
            number(g.scaled_up, 5),
            fixed(g.ratio, 4),
            "made equal" if g.imposed else "matches" if g.matches else "differs",
        ]
        for g in comparison.groups
    ]
    return Table(
        f"Dimensionless groups; F is {comparison.largest_force:g} N times the force factor, T_o as in the files. The "
        "factors of force and time are those that make Theta and J/(kappa t^2) equal",
        ["group", named(comparison.real_size), named(comparison.scaled_up), "ratio", ""],
        rows,
    )


def _errors(context: Context, comparison: Comparison) -> Table:
    rows = []
    limits = [comparison.largest_force]
    if context.is_paper and comparison.largest_force > EQUIVALENT_FORCE.value:
        limits.insert(0, EQUIVALENT_FORCE.value)
    for name, whole in comparison.errors.items():
        for limit in limits:
            error = comparison.error(pretension=whole.scaled_up_pretension, largest_force=limit)
            key = f"similarity.{name.replace(' ', '_')}.to_{limit:g}N"
            about = f"pretension {name} ({error.scaled_up_pretension:.4g} N), forces to {limit:g} N"
            context.add(f"{key}.largest", error.largest, "deg", f"Largest similarity error, {about}")
            context.add(f"{key}.rms", error.rms, "deg", f"Root mean square similarity error, {about}")
            context.add(
                f"{key}.quantile_95",
                error.quantile_95,
                "deg",
                f"95 % quantile of the similarity error, {about}",
            )
            context.add(f"{key}.unsolved", error.unsolved, "1", f"Share of points without equilibrium, {about}")
            angle, force = error.worst
            context.add(f"{key}.worst_handle", np.degrees(angle), "deg", f"Handle angle of the largest error, {about}")
            context.add(f"{key}.worst_force", force, "N", f"Force of the largest error, {about}")
            rows.append(
                [
                    f"{error.scaled_up_pretension:.4g} N ({name})",
                    f"0 … {limit:g} N",
                    fixed(error.rms, 3),
                    fixed(error.quantile_95, 3),
                    fixed(error.largest, 3),
                    f"θ_h = {fixed(np.degrees(angle), 1)}°, {force:.2f} N",
                    f"{100 * error.unsolved:.1f} %",
                ]
            )
    reach = np.degrees(context.inst.output_range)
    return Table(
        f"Similarity error: output of {named(comparison.scaled_up)} minus {named(comparison.real_size)} [°] over "
        f"−{reach:.0f} … {reach:.0f}° of unloaded output",
        [
            "pretension scaled-up",
            f"force on {named(comparison.real_size)}",
            "rms",
            "95 %",
            "largest",
            "largest at",
            "no equilibrium",
        ],
        rows,
    )


def _with_friction(context: Context, comparison: Comparison) -> Table:
    """Errors at rest and in time, over loops of the handle through the working range."""
    sets: dict[str, Any] = {"held": None}
    if context.is_paper:
        factor = float(comparison.force_factor())
        sets = {"fig14": [force / factor for force in comparison.scaled_up.conditions.forces]} | sets
    rows = []
    for name, pretension in (("scaled", None), ("as used", comparison.scaled_up.pretension)):
        for which, several in sets.items():
            for kind, measure in (("at rest", comparison.error_at_rest), ("in time", comparison.cycle_error)):
                error = measure(pretension=pretension, forces=several)
                if np.isnan(error.largest):
                    continue
                key = f"similarity_with_friction.{name.replace(' ', '_')}.{which}.{kind.replace(' ', '_')}"
                about = (
                    f"with friction {kind}, pretension {name}, "
                    f"{'the loads of Fig. 14' if which == 'fig14' else 'loads up to the largest that both hold'}"
                )
                context.add(f"{key}.rms", error.rms, "deg", f"Root mean square similarity error {about}")
                context.add(
                    f"{key}.quantile_95", error.quantile_95, "deg", f"95 % quantile of similarity error {about}"
                )
                context.add(f"{key}.largest", error.largest, "deg", f"Largest similarity error {about}")
                at = error.worst
                rows.append(
                    [
                        f"{error.scaled_up_pretension:.4g} N ({name})",
                        f"to {error.force.max():.3g} N",
                        kind,
                        fixed(error.rms, 3),
                        fixed(error.quantile_95, 3),
                        fixed(error.largest, 3),
                        f"θ_h = {fixed(np.degrees(at.handle_angle), 1)}°, {at.force:.2f} N, "
                        f"{'flexing' if at.flexing else 'extending'}",
                    ]
                )
    return Table(
        "Similarity error with friction [°], over loops of the handle through the working range under constant forces: "
        "at rest after every step, and in time on the twin, both as their files mean them. At the largest load both "
        "hold, single jumps of a tip make the largest error",
        ["pretension scaled-up", f"force on {named(comparison.real_size)}", "", "rms", "95 %", "largest", "largest at"],
        rows,
    )


def _causes(context: Context, comparison: Comparison) -> Table:
    """Which group's mismatch makes the error, without friction and with it."""
    limit = EQUIVALENT_FORCE.value if context.is_paper else None
    rows = []
    for name, pretension in (("scaled", None), ("as used", comparison.scaled_up.pretension)):
        several = None if limit is None else [limit * share for share in (0.0, 0.5, 1.0)]
        for kind, options in (
            ("without", {"largest_force": limit}),
            ("with", {"friction": True, "forces": several}),
        ):
            try:
                causes = comparison.causes(pretension=pretension, **options)
            except ValueError:
                # Nothing that both hold: there is no error to explain.
                continue
            for cause in causes.causes[:_CAUSES]:
                if not abs(cause.at_worst) > _NO_CAUSE:
                    continue
                key = f"causes.{name.replace(' ', '_')}.{kind}_friction.{cause.name}"
                about = f"that {cause.name} causes, {kind} friction, pretension {name}"
                context.add(f"{key}.rms", cause.rms, "deg", f"Root mean square similarity error {about}")
                context.add(f"{key}.at_worst", cause.at_worst, "deg", f"Similarity error at its largest {about}")
                rows.append(
                    [
                        f"{name}, {kind} friction",
                        cause.name,
                        number(cause.real_size),
                        number(cause.scaled_up),
                        fixed(cause.at_worst, 3),
                        fixed(cause.rms, 3),
                        f"{fixed(causes.error, 3)} / {fixed(causes.error_rms, 3)}",
                    ]
                )
    to = "" if limit is None else f", loads up to {limit:g} N"
    return Table(
        f"What causes the error: the groups whose mismatch does most, each at the others constant{to} [°]",
        ["pretension", "group", named(comparison.real_size), named(comparison.scaled_up), "where largest", "rms", "of"],
        rows,
    )


def _map(comparison: Comparison) -> Plot:
    fig, axes = style.figure(2, width=8.6, height=3.7)
    curves: dict[str, Any] = {}
    bound = max(0.5, *(min(5.0, error.quantile_95) for error in comparison.errors.values()))
    for axis, (name, error) in zip(axes, comparison.errors.items(), strict=True):
        mesh = axis.pcolormesh(
            np.degrees(error.handle_angle), error.force, error.error.T, cmap="RdBu_r", vmin=-bound, vmax=bound,
            shading="gouraud", rasterized=True,
        )  # fmt: skip
        axis.set_facecolor("#d5dae0")
        axis.grid(visible=False)
        axis.set(
            title=f"T$_o$ = {error.scaled_up_pretension:.3g} N ({name})",
            xlabel="handle angle $\\theta_h$ [deg]",
            ylabel="force on the instrument [N]",
        )
        curves |= _flat(name, error)
    fig.colorbar(mesh, ax=axes, label="error [deg]", extend="both")
    return Plot(
        "similarity_error",
        f"Similarity error: output of {named(comparison.scaled_up)} minus {named(comparison.real_size)}, force factor "
        f"{comparison.force_factor():.3f}; the colour scale ends at ±{bound:.2g}°. Grey: no equilibrium.",
        fig,
        curves,
    )


def _flat(name: str, error: SimilarityError) -> dict[str, Any]:
    handle, force = np.meshgrid(np.degrees(error.handle_angle), error.force, indexing="ij")
    return {
        "handle_angle [deg]": handle.ravel(),
        "force [N]": force.ravel(),
        f"error, pretension {name} [deg]": error.error.ravel(),
    }
