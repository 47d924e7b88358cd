"""Scale-model design: what the paper's choice was worth, what else its workshop allowed, and the round trip."""

import numpy as np

from tenodesis import scaling
from tenodesis.instrument import Instrument, TendonGear
from tenodesis.paper.context import Context
from tenodesis.paper.published import TIP_FORCE
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named, number
from tenodesis.run import Array
from tenodesis.scaling import Design, Front, Objectives, figures
from tenodesis.scaling.round_trip import RoundTrip, round_trip

ROUND_TRIP_AMPLITUDE = np.radians(60.0)

_UNITS = ("deg", "N", "m", "1")
_BETWEEN = 100  # rows of a curve in the figure's file


def section(context: Context) -> Section:
    """Design scale models under the paper's constraints and with standard parts, and carry an experiment back."""
    scaled = context.scaled
    if not context.is_paper or not isinstance(scaled, TendonGear):
        return Section(
            "design",
            "Scale-model design",
            "<p><code>tenodesis scale</code> designs a scale model of an instrument from stock parts; the report does "
            "so for the paper's.</p>",
        )
    model = context.inst.axis(context.inst.axes[0])
    constraints = scaling.load("paper")
    pins = {
        key: getattr(scaled, key)
        for key in (
            "distal_gear_radius",
            "proximal_gear_radius",
            "overall_length",
            "end_effector_length",
            "handle_length",
        )
    }
    free, stock = scaling.design(model, constraints), scaling.design(model)
    designs = {
        "paper": scaling.design(model, constraints, pins=pins)[0],
        "paper_best": free[free.best()],
        "stock_best": stock[stock.best()],
    }
    names = {
        "paper": f"the paper's, {named(scaled)}",
        "paper_best": "most similar in the paper's workshop",
        "stock_best": "most similar of standard parts, to 3 N",
    }
    rivals = free.rivals(designs["paper"].objectives)
    context.add("design.paper.beaten_by", len(rivals), "1", "Scale models under the paper's constraints that beat its")
    for name, value, unit in zip(Objectives._fields, rivals[0].objectives if rivals else (), _UNITS, strict=False):
        about = f"{name.replace('_', ' ').capitalize()} of the most similar one that beats the paper's"
        context.add(f"design.paper.rival.{name}", value, unit, about)
    for key, front in (("paper", free), ("stock", stock)):
        context.add(f"design.{key}.examined", front.examined, "1", f"Scale models judged, {key} catalogue")
        context.add(f"design.{key}.front", len(front), "1", f"Designs on the front, {key} catalogue")
    told = scaling.rivals_text(free, designs["paper"].objectives)
    text = (
        f"<p>Of {free.examined} scale models that gears of standard modules, the paper's rope and lengths up to 1 m "
        f"allow, judged up to its {TIP_FORCE.value:g} N, {len(free)} are beaten by none in similarity error, force "
        f"resolution, size and tension margin together. As for the paper's own prototype, {told} With standard ropes "
        f"and up to {max(model.conditions.forces):g} N on the real instrument, slack and all, {stock.examined} were "
        "judged.</p>"
    )
    trips = {key: _trips(context, key, design, scaled) for key, design in designs.items()}
    table = _round_trips(names, trips)
    return Section(
        "design",
        "Scale-model design",
        text,
        [_front(free, designs["paper"].objectives, designs["paper_best"].objectives), _loop(trips["paper"])],
        [_designs(context, designs, names), table],
    )


def _designs(context: Context, designs: dict[str, Design], names: dict[str, str]) -> Table:
    rows = []
    for key, design in designs.items():
        for name, value, unit in zip(Objectives._fields, design.objectives, _UNITS, strict=True):
            context.add(f"design.{key}.{name}", value, unit, f"{name.replace('_', ' ').capitalize()}, {names[key]}")
        inst = design.scaled_up
        assert isinstance(inst, TendonGear)
        one = design.objectives
        rows.append(
            [
                names[key],
                f"{1e3 * inst.distal_gear_radius:.4g} / {1e3 * inst.proximal_gear_radius:.5g}",
                f"{1e3 * inst.end_effector_length:.4g}",
                design.choice.rope.name,
                f"{inst.pretension:.3g}",
                fixed(one.similarity_error, 3),
                number(1e3 * one.force_resolution, 3),
                f"{1e3 * one.overall_length:.4g}",
                fixed(one.tension_margin, 2),
            ]
        )
    return Table(
        "Designs: similarity error is the largest over the working range, resolution that of a force on the real "
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


def _trips(context: Context, key: str, design: Design, scaled: Instrument) -> dict[float, RoundTrip]:
    """Return the round trips without a force and under Fig. 14's largest, by force on the real-size instrument."""
    real = max(scaled.conditions.forces) / _force_factor(context)
    trips = {}
    for force in (0.0, real):
        trip = round_trip(
            design.real_size,
            design.scaled_up,
            force * design.comparison.factors["force"],
            amplitude=float(ROUND_TRIP_AMPLITUDE),
        )
        about = f"round trip over a hysteresis cycle, {force:.2g} N on the real-size instrument, {key} design"
        context.add(f"round_trip.{key}.{force:.2g}N.rms", trip.rms, "deg", f"Root mean square difference, {about}")
        context.add(f"round_trip.{key}.{force:.2g}N.largest", trip.largest, "deg", f"Largest difference, {about}")
        trips[force] = trip
    return trips


def _force_factor(context: Context) -> float:
    """Return the force factor of the paper's pair, from the report's own table."""
    middle = np.degrees(context.inst.output_range / 2)
    return context.results[f"table2.force_factor.at_{middle:.4g}deg"].value


def _round_trips(names: dict[str, str], trips: dict[str, dict[float, RoundTrip]]) -> Table:
    rows = [
        [names[key], f"{force:.2g} N", fixed(trip.rms, 3), fixed(trip.largest, 2)]
        for key, several in trips.items()
        for force, trip in several.items()
    ]
    return Table(
        "Round trip: the scaled-up twin's recorded output angle, carried to real-size units, minus the real-size "
        f"twin's own over a hysteresis cycle to ±{np.degrees(ROUND_TRIP_AMPLITUDE):.0f}° [°]",
        ["design", "force on the real-size instrument", "rms", "largest"],
        rows,
    )


def _front(front: Front, paper: Objectives, best: Objectives) -> Plot:
    costs = front.sweep.costs
    return Plot(
        "design_front",
        "The front under the paper's constraints: every design that no other beats in all four objectives.",
        figures.draw_front(front, {"the paper's": paper, "most similar": best}),
        {
            "similarity error [deg]": costs[:, 0],
            "force resolution [N]": costs[:, 1],
            "overall length [m]": costs[:, 2],
            "tension margin": 1 / costs[:, 3],
        },
    )


def _loop(trips: dict[float, RoundTrip]) -> Plot:
    fig, axes = style.figure(2, width=8.6, height=3.7)
    curves: dict[str, Array] = {}
    for axis, (force, trip) in zip(axes, trips.items(), strict=True):
        handle = np.degrees(trip.handle_angle)
        step = max(handle.size // (20 * _BETWEEN), 1)
        axis.plot(handle[::step], np.degrees(trip.direct[::step]), color=style.INK, label="real-size twin")
        axis.plot(
            handle[::step],
            np.degrees(trip.predicted[::step]),
            color=style.ACCENT,
            lw=1.0,
            label="scaled-up twin's encoder, carried over",
        )
        axis.set(
            title="no load" if force == 0 else f"{force:.2g} N on the real-size instrument",
            xlabel="handle angle $\\theta_h$ [deg]",
            ylabel="output angle $\\theta_e$ [deg]",
        )
        heading = f"{force:.2g} N"
        curves |= {
            f"handle_angle, {heading} [deg]": handle[::step],
            f"output_angle, real-size, {heading} [deg]": np.degrees(trip.direct[::step]),
            f"output_angle, carried over, {heading} [deg]": np.degrees(trip.predicted[::step]),
        }
    axes[0].legend(loc="upper left")
    return Plot(
        "round_trip",
        "Round trip over a hysteresis cycle with friction, the paper's prototype with its pretension scaled.",
        fig,
        curves,
    )
