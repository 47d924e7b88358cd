"""Fig. 14's cycles with compensation, and a quick wrist: how well the tip follows the handle while it moves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.control import Controller, LawName
from tenodesis.instrument import Instrument
from tenodesis.paper import compensated_run as bench
from tenodesis.paper.context import Context
from tenodesis.paper.input_output import forces
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named
from tenodesis.run import Run
from tenodesis.statics import Actuation
from tenodesis.twin import TIME_STEP, Twin

Array = NDArray[np.float64]

TITLE = "Flexion and extension with compensation"
RATIO_TO_PAPER, RATIO_TO_OFF = 4.0, 8.0

_FREQUENCY = 0.25  # Hz
_CYCLES, _LEARNING = 5, 1
_LOADING, _RESTING = 1.0, 2.0  # s
_SEED = 14
_KEPT = 20
_TURNED = 0.5  # s
_WRIST = ((0.5, 6.0, 0.0), (1.0, 3.0, 1.0), (1.5, 2.0, 2.0), (2.0, 1.0, 3.0))  # Hz, shares, rad
_PERIODS, _PERIOD = 20, 2.0  # s
_ENDS = 3  # periods or cycles that count as start and as end


class Way(NamedTuple):
    """How the motors work."""

    key: str
    name: str
    law: LawName
    actuation: Actuation
    color: str


WAYS = (
    Way("off", "no compensation", "off", "differential", style.MUTED),
    Way("paper_one_motor", "eq. 22, one motor", "paper", "agonist", style.LOADS[3]),
    Way("paper", "eq. 22, both motors", "paper", "differential", style.ANTAGONIST),
    Way("robust", "robust law", "robust", "differential", style.AGONIST),
)


class Followed(NamedTuple):
    """What a motion came to once learning is over: error against eq. 18 (rad) by step, and what is made of it."""

    run: Run
    error: Array
    rmse: float
    """deg"""
    largest: float
    """deg"""
    growth: float
    """Of the error, the end over the start."""
    mean_at_start: float
    """Mean tension of both tendons, N."""
    mean_at_end: float


def amplitude(inst: Instrument) -> float:
    """Return how far the handle is moved, rad: as far as the conditions say, or through the working range."""
    return min(max(inst.conditions.handle_angles or (statics.reach(inst),)), statics.reach(inst))


def cycles(inst: Instrument) -> Array:
    """Return the handle angle of the cycles by step, rad; the first is still learning."""
    time = np.arange(1, round(_CYCLES / _FREQUENCY / TIME_STEP) + 1) * TIME_STEP
    turned: Array = amplitude(inst) / 2 * (1 - np.cos(2 * np.pi * _FREQUENCY * time))
    return turned


def wrist(inst: Instrument) -> Array:
    """Return the handle angle of a quick wrist by step, rad: sines of up to 2 Hz about the middle of the way."""
    time = np.arange(1, round((1 + _PERIODS) * _PERIOD / TIME_STEP) + 1) * TIME_STEP
    sines = sum(share * np.sin(2 * np.pi * frequency * time + phase) for frequency, share, phase in _WRIST)
    whole = sum(share for _, share, _ in _WRIST)
    turned: Array = amplitude(inst) / 2 * np.minimum(time / _PERIOD, 1) * (1 + sines / whole)
    return turned


def follow(inst: Instrument, motion: Array, force: float, way: Way, period: float) -> Followed:
    """Run a motion under a force with the motors at work, from when the force is on; the first period is left out."""
    still = np.zeros(round((_LOADING + _RESTING) / TIME_STEP))
    handle = np.concatenate([still, motion])
    rising = np.minimum(np.arange(1, handle.size + 1) * TIME_STEP / _LOADING, 1)
    controller = Controller(bench.known(inst), law=way.law, actuation=way.actuation)
    run = Twin(inst, seed=_SEED).run(handle, force * rising, controller=controller)
    first = still.size + round(period / TIME_STEP)
    error = (run["output_angle"] - statics.output_angle(inst, handle))[first:]
    mean = run["tension"].mean(1)[first:]
    part = round(min(_ENDS * period / TIME_STEP, error.size / 2))
    return Followed(
        run,
        error,
        _rms(error),
        float(np.degrees(np.abs(error).max())),
        _rms(error[-part:]) / _rms(error[:part]),
        float(mean[:part].mean()),
        float(mean[-part:].mean()),
    )


def _rms(error: Array) -> float:
    return float(np.degrees(np.sqrt(np.mean(error**2))))


def section(context: Context) -> Section:
    """Compute the cycles under every force of the instrument's conditions, and the quick wrist."""
    inst = context.tested
    if bench.refusal(inst) is not None:
        return Section("compensated_cycles", TITLE, f"<p>Not run: {named(inst)} cannot be compensated.</p>")
    loads = forces(inst)[1:]
    cases = [(force, way) for force in loads for way in WAYS]
    slow = cycles(inst)
    found = dict(zip(cases, bench.together(lambda case: follow(inst, slow, *case, 1 / _FREQUENCY), cases), strict=True))
    loads = [force for force in loads if all(found[force, way] is not None for way in WAYS)]
    if not loads:
        text = f"<p>Not run: {named(inst)} holds none of the forces while its handle moves.</p>"
        return Section("compensated_cycles", TITLE, text)
    whole = {case: one for case, one in found.items() if one is not None and case[0] in loads}
    quick, rows = _wrist(context, inst, [0.0, loads[min(1, len(loads) - 1)]])
    degrees = f"{np.degrees(amplitude(inst)):.3g}"
    plot = Plot(
        "fig14_compensated",
        f"Error of the tip against eq. 18 over the handle’s angle, {named(inst)}, T<sub>o</sub> = "
        f"{inst.pretension:g} N, the last of {_CYCLES} cycles of 0–{degrees}° at {_FREQUENCY:g} Hz "
        f"({context.figure_of('Fig. 14')} without compensation).",
        _draw(loads, whole),
        _curves(loads, whole),
    )
    table = Table(
        f"RMSE of the tip against eq. 18 [°] over cycles 2 to {_CYCLES} of 0–{degrees}° at {_FREQUENCY:g} Hz, the "
        "robust law’s largest error, by how much its RMSE is smaller, and the mean tension of both tendons under it",
        [
            "force",
            *(way.name for way in WAYS),
            "robust, largest [°]",
            f"vs none (≥&nbsp;{RATIO_TO_OFF:g})",
            f"vs one motor (≥&nbsp;{RATIO_TO_PAPER:g})",
            f"vs both (≥&nbsp;{RATIO_TO_PAPER:g})",
            "mean tension, start → end [N]",
        ],
        [_row(context, force, {way.key: whole[force, way] for way in WAYS}) for force in loads],
    )
    turned = np.mean([_at_turns(whole[force, WAYS[-1]].error) for force in loads])
    return Section(
        "compensated_cycles", TITLE, _text(context, quick, float(turned)) + bench.caveat(inst), [plot], [table, rows]
    )


def _at_turns(error: Array) -> float:
    """Return the share of the squared error that falls in the time after the handle has turned."""
    samples, after = round(1 / _FREQUENCY / TIME_STEP), round(_TURNED / TIME_STEP)
    halves = error.reshape(-1, samples // 2) ** 2
    return float(halves[:, :after].sum() / halves.sum())


def _row(context: Context, force: float, by: dict[str, Followed]) -> list[str]:
    at = f"at_{force:g}N"
    for way in WAYS:
        context.add(
            f"compensated_cycles.rmse.{way.key}.{at}",
            by[way.key].rmse,
            "deg",
            f"RMSE of the tip against eq. 18 over the cycles, {way.name}, {force:g} N",
        )
    robust = by["robust"]
    ratios = {}
    for key, name in (
        ("off", "no compensation"),
        ("paper_one_motor", "eq. 22 by one motor"),
        ("paper", "eq. 22 by both"),
    ):
        ratios[key] = context.add(
            f"compensated_cycles.ratio.{key}.{at}",
            by[key].rmse / robust.rmse,
            "1",
            f"RMSE of {name} over that of the robust law, {force:g} N",
        )
    context.add(
        f"compensated_cycles.largest.{at}",
        robust.largest,
        "deg",
        f"Largest error of the tip under the robust law, {force:g} N",
    )
    return [
        f"{force:g} N",
        *(fixed(by[way.key].rmse) for way in WAYS),
        fixed(robust.largest),
        judged(ratios["off"], ratios["off"] >= RATIO_TO_OFF, 1),
        judged(ratios["paper_one_motor"], ratios["paper_one_motor"] >= RATIO_TO_PAPER, 1),
        judged(ratios["paper"], ratios["paper"] >= RATIO_TO_PAPER, 1),
        f"{fixed(robust.mean_at_start, 1)} → {fixed(robust.mean_at_end, 1)}",
    ]


def judged(value: float, met: bool, decimals: int = 2) -> str:
    """Return a figure with whether it meets its target."""
    return f"{fixed(value, decimals)} {'met' if met else 'missed'}"


def _wrist(context: Context, inst: Instrument, loads: Sequence[float]) -> tuple[dict[float, Followed], Table]:
    ways = [WAYS[0], WAYS[-1]]
    cases = [(force, way) for force in loads for way in ways]
    motion = wrist(inst)
    found = dict(zip(cases, bench.together(lambda case: follow(inst, motion, *case, _PERIOD), cases), strict=True))
    robust: dict[float, Followed] = {}
    rows = []
    for force, way in cases:
        one = found[force, way]
        if one is None:
            continue
        if way.key == "robust":
            robust[force] = one
        for name, value, unit, told in (
            ("rmse", one.rmse, "deg", "RMSE of the tip against eq. 18"),
            ("growth", one.growth, "1", "RMSE over the last three periods, over that of the first three"),
            ("mean_tension_growth", one.mean_at_end - one.mean_at_start, "N", "Growth of the mean tension"),
        ):
            context.add(
                f"compensated_cycles.wrist.{name}.{way.key}.at_{force:g}N",
                value,
                unit,
                f"{told}, quick wrist, {way.name}, {force:g} N",
            )
        rows.append(
            [
                f"{force:g} N, {way.name}",
                fixed(one.rmse),
                fixed(one.largest),
                fixed(one.growth),
                fixed(one.mean_at_start),
                fixed(one.mean_at_end),
                "yes" if one.run["faults"].any() else "no",
            ]
        )
    speed = float(np.degrees(np.abs(np.diff(motion)).max() / TIME_STEP))
    table = Table(
        f"A quick wrist: sines of 0.5 to 2 Hz, up to {speed:.0f}°/s, {_PERIODS} periods of {_PERIOD:g} s; growth of "
        f"the RMSE and mean tension from the first {_ENDS} to the last {_ENDS}",
        [
            "load and law",
            "RMSE [°]",
            "largest [°]",
            "RMSE grows by",
            "mean tension at start [N]",
            "at end [N]",
            "fault",
        ],
        rows,
    )
    return robust, table


def _text(context: Context, quick: dict[float, Followed], turned: float) -> str:
    ratios = {
        key: [r.value for name, r in context.results.items() if name.startswith(f"compensated_cycles.ratio.{key}.at")]
        for key in ("off", "paper_one_motor", "paper")
    }
    text = (
        "<p>The handle goes back and forth under a constant force with the controller at work. The robust law’s RMSE "
        f"is {_span(ratios['off'])} times smaller than without compensation, {_span(ratios['paper_one_motor'])} times "
        f"smaller than with eq. 22 as the paper has it, by the agonist’s motor, and {_span(ratios['paper'])} times "
        "smaller than with eq. 22 by both motors.</p>"
    )
    if min(ratios["off"]) < RATIO_TO_OFF or min(ratios["paper"] + ratios["paper_one_motor"]) < RATIO_TO_PAPER:
        text += (
            f"<p>Where a ratio is missed: {100 * turned:.0f} % of the robust law’s squared error falls "
            f"in the {_TURNED:g} s after the handle has turned. There every contact changes over to its other edge, "
            "and until the motors have wound through the bands the tip stands while the handle leaves.</p>"
        )
    if quick:
        grown = max(abs(one.growth - 1) for one in quick.values())
        pulled = max(abs(one.mean_at_end - one.mean_at_start) for one in quick.values())
        text += (
            f"<p>Under the quick wrist the robust law’s error changes by {100 * grown:.0f} % at most from the start to "
            f"the end of {_PERIODS} periods, and the mean tension by {pulled:.2g} N.</p>"
        )
    return text


def _span(values: Sequence[float]) -> str:
    low, high = (f"{value:.1f}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _draw(loads: Sequence[float], whole: dict[tuple[float, Way], Followed]) -> Figure:
    fig = Figure(figsize=(3.1 * len(loads) + 0.6, 3.8), layout="constrained")
    axes = list(fig.subplots(1, len(loads), squeeze=False, sharey=True)[0])
    for axis, force in zip(axes, loads, strict=True):
        for way in WAYS:
            handle, error = _last(whole[force, way])
            axis.plot(handle, error, color=way.color, lw=1.2)
        axis.axhline(0, color=style.INK, ls="--", lw=0.8)
        axis.set(title=f"{force:g} N", xlabel="handle angle $\\theta_h$ [deg]")
    axes[0].set_ylabel("output angle − eq. 18 [deg]")
    handles = [axes[0].plot([], [], color=way.color, label=way.name)[0] for way in WAYS]
    fig.legend(handles=handles, loc="outside upper left", ncols=len(WAYS))
    return fig


def _last(one: Followed) -> tuple[Array, Array]:
    samples = round(1 / _FREQUENCY / TIME_STEP)
    return np.degrees(one.run["handle_angle"][-samples:][::_KEPT]), np.degrees(one.error[-samples:][::_KEPT])


def _curves(loads: Sequence[float], whole: dict[tuple[float, Way], Followed]) -> dict[str, Array]:
    curves: dict[str, Array] = {}
    for force in loads:
        for way in WAYS:
            handle, error = _last(whole[force, way])
            curves[f"handle_angle {way.key} at {force:g} N [deg]"] = handle
            curves[f"error {way.key} at {force:g} N [deg]"] = error
    return curves
