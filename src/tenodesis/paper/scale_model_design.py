"""Scale-model design: how the paper's choice compares with the other designs of its workshop, and the round trip."""

import numpy as np

from tenodesis import scaling
from tenodesis.instrument import TendonGear
from tenodesis.paper.context import Context
from tenodesis.paper.published import TIP_FORCE
from tenodesis.report import style
from tenodesis.report.content import Chart, Plot, ResultColumn, Section, Table, fixed, named, number
from tenodesis.scaling import Design, Front, Objectives, figures
from tenodesis.scaling.transfer import RoundTrip, round_trip

ROUND_TRIP_AMPLITUDE = np.radians(60.0)

_UNITS = dict(zip(Objectives._fields, ("deg", "N", "m", "1"), strict=True))
_PINNED = ("distal_gear_radius", "proximal_gear_radius", "overall_length", "end_effector_length", "handle_length")
_DRAWN = 2000  # points of a curve
_TITLE = "Scale-model design"


def section(context: Context) -> Section:
    """Design scale models under the paper's constraints and with standard parts, and make the round trip."""
    scaled = context.scaled
    if not context.is_paper or not isinstance(scaled, TendonGear):
        return Section(
            "design",
            _TITLE,
            "<p><code>tenodesis scale</code> designs a scale model of an instrument from stock parts; the report does "
            "this for the paper's instrument only.</p>",
        )
    model = context.inst.planar[0]
    constraints = scaling.load("paper")
    free, stock = scaling.design(model, constraints), scaling.design(model)
    designs = {
        "paper": scaling.design(model, constraints, pins={key: getattr(scaled, key) for key in _PINNED})[0],
        "paper_best": free[free.best()],
        "stock_best": stock[stock.best()],
    }
    names = {
        "paper": f"the paper's, {named(scaled)}",
        "paper_best": "most similar in the paper's workshop",
        "stock_best": "most similar of standard parts, to 3 N",
    }
    own, best = designs["paper"].objectives, designs["paper_best"].objectives
    rivals = free.rivals(own)
    context.add(
        "design.paper.beaten_by",
        len(rivals),
        "1",
        "Scale models under the paper's constraints that beat the paper's own",
    )
    for name, value in (rivals[0].objectives._asdict() if rivals else {}).items():
        about = f"{name.replace('_', ' ').capitalize()} of the most similar scale model that beats the paper's"
        context.add(f"design.paper.rival.{name}", value, _UNITS[name], about)
    for key, front in (("paper", free), ("stock", stock)):
        context.add(f"design.{key}.examined", front.examined, "1", f"Scale models judged, {key} catalogue")
        context.add(f"design.{key}.front", len(front), "1", f"Designs on the front, {key} catalogue")
    text = (
        f"<p>Gears of standard modules, the paper's rope and lengths up to 1 m allow {free.examined} scale models. "
        f"Judged up to the paper's {TIP_FORCE.value:g} N, {len(free)} of them are beaten by no other in similarity "
        "error, force resolution, size and tension margin together. For the paper's own scaled-up instrument: "
        f"{scaling.rivals_text(free, own)} With standard ropes and up to {max(model.conditions.forces):g} N on the "
        f"real-size instrument, slack included, {stock.examined} were judged.</p>"
    )
    largest = max(scaled.conditions.forces) / designs["paper"].comparison.factors["force"]
    trips = {key: {force: _round_trip(design, force) for force in (0.0, largest)} for key, design in designs.items()}
    plots = [_front(free, {"the paper's": own, "most similar": best}), _loop(trips["paper"])]
    tables = [_designs(context, designs, names), _round_trips(context, names, trips)]
    return Section("design", _TITLE, text, plots, tables)


def _designs(context: Context, designs: dict[str, Design], names: dict[str, str]) -> Table:
    rows = []
    for key, design in designs.items():
        for name, value in design.objectives._asdict().items():
            about = f"{name.replace('_', ' ').capitalize()}, {names[key]}"
            context.add(f"design.{key}.{name}", value, _UNITS[name], about)
        inst = design.scaled_up
        assert isinstance(inst, TendonGear)
        objectives = design.objectives
        rows.append(
            [
                names[key],
                f"{1e3 * inst.distal_gear_radius:.4g} / {1e3 * inst.proximal_gear_radius:.5g}",
                f"{1e3 * inst.end_effector_length:.4g}",
                design.choice.rope.name,
                f"{inst.pretension:.3g}",
                fixed(objectives.similarity_error, 3),
                number(1e3 * objectives.force_resolution, 3),
                f"{1e3 * objectives.overall_length:.4g}",
                fixed(objectives.tension_margin, 2),
            ]
        )
    return Table(
        "Designs: similarity error is the largest over the working range, resolution that of a force on the real-size "
        "instrument, margin the rope's breaking load over the largest tension",
        [
            "design",
            "r / R [mm]",
            "l_d [mm]",
            "rope",
            "T_o [N]",
            "error [°]",
            "resolution [mN]",
            "length [mm]",
            "margin",
        ],
        rows,
    )


def _round_trip(design: Design, force: float) -> RoundTrip:
    """Return the round trip of a design under a force on the real-size instrument, N."""
    scaled_force = force * design.comparison.factors["force"]
    return round_trip(design.real_size, design.scaled_up, scaled_force, amplitude=float(ROUND_TRIP_AMPLITUDE))


def _round_trips(context: Context, names: dict[str, str], trips: dict[str, dict[float, RoundTrip]]) -> Table:
    key = "round_trip.{key}.{force:.2g}N"
    about = "round trip over a hysteresis cycle, {force:.2g} N on the real-size instrument, {key} design"
    table = context.table(
        "Round trip: the scaled-up twin's recorded output angle, scaled back to the real-size instrument, minus the "
        f"real-size twin's own over a hysteresis cycle to ±{np.degrees(ROUND_TRIP_AMPLITUDE):.0f}° [°]",
        "design",
        "force on the real-size instrument",
        ResultColumn("rms", f"{key}.rms", "deg", f"Root mean square difference, {about}", digits=3),
        ResultColumn("largest", f"{key}.largest", "deg", f"Largest difference, {about}"),
    )
    for design, by_force in trips.items():
        for force, trip in by_force.items():
            table.row(names[design], f"{force:.2g} N", trip.rms, trip.largest, key=design, force=force)
    return table


def _front(front: Front, marked: dict[str, Objectives]) -> Plot:
    chart = Chart(figures.draw_front(front, marked))
    costs = front.sweep.costs
    chart.keep("similarity error [deg]", costs[:, 0])
    chart.keep("force resolution [N]", costs[:, 1])
    chart.keep("overall length [m]", costs[:, 2])
    chart.keep("tension margin", 1 / costs[:, 3])
    return chart.plot(
        "design_front",
        "The front under the paper's constraints: every design that no other beats in all four objectives.",
    )


def _loop(trips: dict[float, RoundTrip]) -> Plot:
    chart, axes = Chart.panels(2, width=8.6, height=3.7)
    for axis, (force, trip) in zip(axes, trips.items(), strict=True):
        every = slice(None, None, max(trip.handle_angle.size // _DRAWN, 1))
        load = f"{force:.2g} N"
        handle = chart.keep(f"handle_angle, {load} [deg]", np.degrees(trip.handle_angle[every]))
        direct, predicted = np.degrees(trip.direct[every]), np.degrees(trip.predicted[every])
        heading = f"output_angle, real-size, {load} [deg]"
        chart.curve(axis, handle, heading, direct, color=style.INK, label="real-size twin")
        heading, label = f"output_angle, carried over, {load} [deg]", "scaled-up twin's encoder, scaled back"
        chart.curve(axis, handle, heading, predicted, color=style.ACCENT, lw=1.0, label=label)
        axis.set(
            title="no load" if force == 0 else f"{load} on the real-size instrument",
            xlabel="handle angle $\\theta_h$ [deg]",
            ylabel="output angle $\\theta_e$ [deg]",
        )
    axes[0].legend(loc="upper left")
    return chart.plot(
        "round_trip",
        "Round trip over a hysteresis cycle with friction, the paper's scaled-up instrument with its pretension "
        "scaled.",
    )
