"""The scale model of an instrument of several joints: factors, groups, and errors of its joints and at the tip."""

from tenodesis.paper.context import Context, has_friction
from tenodesis.paper.tables_1_2_scale_model import groups
from tenodesis.report.content import ResultColumn, Section, Table, fixed, named
from tenodesis.scaling.plan import FACTORS, draw_losses
from tenodesis.similarity.joints import JointComparison, JointError, compare_joints


def section(context: Context) -> Section:
    """Compare the instrument with its scale model."""
    pair = compare_joints(context.given, context.scaled or context.given)
    text = (
        "<p>Two instruments of different size lose the same angles if loads are larger by their factors, which make "
        "both lose the same to first order, by least squares over the working range. Groups that do not match show in "
        "degrees below, and in how far they would move the real-size tip, of two jaws the farther one.</p>"
    )
    plot = draw_losses(pair).plot(
        "similarity",
        f"Angles that loads leave in a bent state: {named(pair.real_size)} (lines) and {named(pair.scaled_up)} "
        "(points), whose loads are divided by their factors.",
    )
    return Section(
        "similarity",
        "Scale model",
        text,
        [plot],
        [
            _factors(context, pair),
            groups(context, pair, "Dimensionless groups, those alike in one row"),
            *_errors(context, pair),
        ],
    )


def _factors(context: Context, pair: JointComparison) -> Table:
    about = "Scale factor: {about}"
    table = context.table(
        "Scale factors; of angles it is 1", "", ResultColumn("factor", "factors.{key}", "1", about, digits=4)
    )
    for key, name in FACTORS.items():
        table.row(name, pair.factors[key], key=key, about=name)
    return table


def _errors(context: Context, pair: JointComparison) -> list[Table]:
    """Return the errors with the scale model's pretensions scaled and as in its file."""
    loads = ", ".join(f"{one.size:.3g} N {one.name}" for one in pair.loads)
    found: list[Table] = []
    kinds = [("without friction", "without_friction", pair.error)]
    if has_friction(pair.real_size) or has_friction(pair.scaled_up):
        kinds.append(("with friction, at rest", "with_friction", pair.error_at_rest))
    for kind, name, measure in kinds:
        for pretension, tensions in (("scaled", None), ("as used", pair.scaled_up.pretensions)):
            caption = f"Similarity error {kind}, pretension {pretension}, loads up to {loads} real-size"
            key = f"similarity.{pretension.replace(' ', '_')}.{name}"
            found.append(
                _error(context, caption, key, f"{kind}, pretension {pretension}", measure(pretensions=tensions))
            )
    return found


def _error(context: Context, caption: str, key: str, about: str, error: JointError) -> Table:
    table = context.table(
        f"{caption}; no equilibrium at {fixed(100 * error.unsolved, 1)} % of the points",
        "",
        ResultColumn("rms", f"{key}.{{of}}.rms", "{unit}", f"Root mean square similarity error of {{of}}, {about}"),
        ResultColumn("largest", f"{key}.{{of}}.largest", "{unit}", f"Largest similarity error of {{of}}, {about}"),
    )
    for joint, rms, largest in zip(error.joints, error.rms, error.largest, strict=True):
        table.row(f"{joint} [°]", rms, largest, of=joint, unit="deg")
    table.row("real-size tip [mm]", 1e3 * error.rms_at_tip, 1e3 * error.largest_at_tip, of="tip", unit="mm")
    return table
