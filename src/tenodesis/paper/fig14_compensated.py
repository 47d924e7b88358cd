"""Fig. 14's cycles with compensation, and fast wrist motion: how well the tip follows the handle while it moves."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tenodesis import statics
from tenodesis.control import Controller, LawName
from tenodesis.instrument import ShortForm
from tenodesis.paper import step_response
from tenodesis.paper.context import DRAWN, Context, has_friction
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Column, Plot, Section, Table, fixed, named
from tenodesis.report.curves import forces
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.statics import Actuation
from tenodesis.twin import TIME_STEP, Twin

TITLE = "Flexion and extension with compensation"
RATIO_TO_PAPER, RATIO_TO_OFF = 4.0, 8.0
"""Required ratio of the other laws' error to the robust law's."""

_FREQUENCY = 0.25  # Hz
_PERIOD = 1 / _FREQUENCY  # s
_CYCLES = 5
_LOADING, _RESTING = 1.0, 2.0  # s
_SEED = 14
_AFTER_REVERSAL = 0.5  # s
_WRIST = ((0.5, 6.0, 0.0), (1.0, 3.0, 1.0), (1.5, 2.0, 2.0), (2.0, 1.0, 3.0))  # Hz, shares, rad
_WRIST_PERIODS, _WRIST_PERIOD = 20, 2.0  # s
_ENDS = 3  # periods or cycles that count as start and as end


class Compensation(NamedTuple):
    """A law and the motors that it uses."""

    key: str
    name: str
    law: LawName
    actuation: Actuation
    color: str


OFF = Compensation("off", "no compensation", "off", "differential", style.MUTED)
ONE_MOTOR = Compensation("paper_one_motor", "eq. 22, one motor", "paper", "agonist", style.LOADS[3])
BOTH_MOTORS = Compensation("paper", "eq. 22, both motors", "paper", "differential", style.ANTAGONIST)
ROBUST = Compensation("robust", "robust law", "robust", "differential", style.AGONIST)
COMPENSATIONS = (OFF, ONE_MOTOR, BOTH_MOTORS, ROBUST)


class Tracking(NamedTuple):
    """The error of the tip against eq. 18 over a motion (rad, by step) after the learning phase, and its measures."""

    run: Run
    error: Array
    rmse: float
    """deg"""
    largest: float
    """deg"""
    growth: float
    """Ratio of the error at the end to that at the start."""
    mean_at_start: float
    """Mean tension of both tendons, N."""
    mean_at_end: float


def amplitude(inst: ShortForm) -> float:
    """Return the amplitude of the handle, rad: from the conditions, or the working range."""
    return min(max(inst.conditions.handle_angles or (statics.reach(inst),)), statics.reach(inst))


def cycles(inst: ShortForm) -> Array:
    """Return the handle angle of the cycles by step, (n,), rad; during the first the observer still learns."""
    time = np.arange(1, round(_CYCLES * _PERIOD / TIME_STEP) + 1) * TIME_STEP
    angle: Array = amplitude(inst) / 2 * (1 - np.cos(2 * np.pi * _FREQUENCY * time))
    return angle


def wrist(inst: ShortForm) -> Array:
    """Return the handle angle of fast wrist motion by step, (n,), rad: sines of up to 2 Hz about half the amplitude."""
    time = np.arange(1, round((1 + _WRIST_PERIODS) * _WRIST_PERIOD / TIME_STEP) + 1) * TIME_STEP
    sines = sum(share * np.sin(2 * np.pi * frequency * time + phase) for frequency, share, phase in _WRIST)
    total = sum(share for _, share, _ in _WRIST)
    angle: Array = amplitude(inst) / 2 * np.minimum(time / _WRIST_PERIOD, 1) * (1 + sines / total)
    return angle


def track(inst: ShortForm, motion: Array, force: float, compensation: Compensation, period: float) -> Tracking:
    """Run a motion (n,), rad, under a force (N) with compensation; the first period (s) is left out of the measures."""
    still = np.zeros(round((_LOADING + _RESTING) / TIME_STEP))
    handle = np.concatenate([still, motion])
    rising = np.minimum(np.arange(1, handle.size + 1) * TIME_STEP / _LOADING, 1)
    model = step_response.controller_model(inst)
    controller = Controller(model, law=compensation.law, actuation=compensation.actuation)
    run = Twin(inst, seed=_SEED).run(handle, force * rising, controller=controller)
    first = still.size + round(period / TIME_STEP)
    error = (run["output_angle"] - statics.output_angle(inst, handle))[first:]
    mean = run["tension"].mean(1)[first:]
    part = round(min(_ENDS * period / TIME_STEP, error.size / 2))
    return Tracking(
        run,
        error,
        _rms(error),
        float(np.degrees(np.abs(error).max())),
        _rms(error[-part:]) / _rms(error[:part]),
        float(mean[:part].mean()),
        float(mean[-part:].mean()),
    )


def _rms(error: Array) -> float:
    return float(np.degrees(campaign.rms(error)))


Found = dict[tuple[float, Compensation], Tracking]


def _tracked(
    inst: ShortForm, motion: Array, loads: Sequence[float], compensations: Sequence[Compensation], period: float
) -> Found:
    """Return the motion under each force, N, with each compensation, as far as the joint holds it."""

    def trial(force: float, compensation: Compensation) -> dict[str, Tracking]:
        return {"tracking": track(inst, motion, force, compensation, period)}

    rows = campaign.run(trial, campaign.cases(force=loads, compensation=compensations), on="threads")
    return {(row["force"], row["compensation"]): row["tracking"] for row in rows}


def section(context: Context) -> Section:
    """Compute the cycles under every force of the instrument's conditions, and fast wrist motion."""
    inst = context.tested
    if not step_response.can_compensate(inst):
        return Section("compensated_cycles", TITLE, f"<p>Not run: {named(inst)} cannot be compensated.</p>")
    slow = cycles(inst)
    found = _tracked(inst, slow, forces(inst)[1:], COMPENSATIONS, _PERIOD)
    loads = [force for force in forces(inst)[1:] if all((force, each) in found for each in COMPENSATIONS)]
    if not loads:
        text = f"<p>Not run: {named(inst)} holds none of the forces while its handle moves.</p>"
        return Section("compensated_cycles", TITLE, text)
    table, text = _cycles(context, loads, found)
    wrist_table, wrist_text = _fast_wrist(context, [0.0, loads[min(1, len(loads) - 1)]])
    text += wrist_text
    return Section("compensated_cycles", TITLE, text, [_plot(context, loads, found)], [table, wrist_table])


def _cycles(context: Context, loads: Sequence[float], found: Found) -> tuple[Table, str]:
    """Return the table of the cycles and the conclusions from it."""
    degrees = f"{np.degrees(amplitude(context.tested)):.3g}"
    rivals = {
        OFF: ("no compensation", "vs none", RATIO_TO_OFF),
        ONE_MOTOR: ("eq. 22 by one motor", "vs one motor", RATIO_TO_PAPER),
        BOTH_MOTORS: ("eq. 22 by both motors", "vs both", RATIO_TO_PAPER),
    }
    table = context.table(
        f"RMSE of the tip against its unloaded angle (eq. 18) [°] over cycles 2 to {_CYCLES} of 0–{degrees}° at "
        f"{_FREQUENCY:g} Hz, the robust law’s largest error, by how many times its RMSE is smaller, and the mean "
        "tension of both tendons",
        "force",
        *(
            Column(
                each.name,
                f"compensated_cycles.rmse.{each.key}.at_{{force:g}}N",
                "deg",
                f"RMSE of the tip against eq. 18 over the cycles, {each.name}, {{force:g}} N",
            )
            for each in COMPENSATIONS
        ),
        Column(
            "robust, largest [°]",
            "compensated_cycles.largest.at_{force:g}N",
            "deg",
            "Largest error of the tip under the robust law, {force:g} N",
        ),
        *(
            Column(
                short if context.is_own else f"{short} (≥&nbsp;{least:g})",
                f"compensated_cycles.ratio.{rival.key}.at_{{force:g}}N",
                "1",
                f"RMSE of {name} over that of the robust law, {{force:g}} N",
                form=partial(fixed, decimals=1) if context.is_own else partial(_judged, least=least),
            )
            for rival, (name, short, least) in rivals.items()
        ),
        "mean tension, start → end [N]",
    )
    ratios: dict[Compensation, list[float]] = {rival: [] for rival in rivals}
    for force in loads:
        robust = found[force, ROBUST]
        for rival, values in ratios.items():
            values.append(found[force, rival].rmse / robust.rmse)
        table.row(
            f"{force:g} N",
            *(found[force, each].rmse for each in COMPENSATIONS),
            robust.largest,
            *(values[-1] for values in ratios.values()),
            f"{fixed(robust.mean_at_start, 1)} → {fixed(robust.mean_at_end, 1)}",
            force=force,
        )
    as_printed = "" if context.is_own else " as in the paper,"
    text = (
        "<p>The handle moves back and forth under a constant force with the controller enabled. The robust law’s RMSE "
        f"is {_span(ratios[OFF])} times smaller than without compensation, {_span(ratios[ONE_MOTOR])} times "
        f"smaller than with the law “paper” (eq. 22){as_printed} by the agonist’s motor, and "
        f"{_span(ratios[BOTH_MOTORS])} times smaller than with it by both motors.</p>"
    )
    if has_friction(context.tested) and (
        context.is_own or any(min(ratios[rival]) < least for rival, (_, _, least) in rivals.items())
    ):
        share = np.mean([_share_after_reversal(found[force, ROBUST].error) for force in loads])
        missed = "" if context.is_own else "Where a ratio is missed: "
        text += (
            f"<p>{missed}{100 * share:.0f} % of the robust law’s squared error falls in the "
            f"{_AFTER_REVERSAL:g} s after the handle has reversed. There friction changes its direction at every "
            "contact, and until the motors have wound through the friction bands the tip stands while the handle "
            "moves on.</p>"
        )
    return table, text


def _judged(ratio: float, least: float) -> str:
    return f"{fixed(ratio, 1)} {'met' if ratio >= least else 'missed'}"


def _share_after_reversal(error: Array) -> float:
    """Return the share of the squared error that falls in the time after the handle has reversed."""
    samples, after = round(_PERIOD / TIME_STEP), round(_AFTER_REVERSAL / TIME_STEP)
    halves = error.reshape(-1, samples // 2) ** 2
    return float(halves[:, :after].sum() / halves.sum())


def _fast_wrist(context: Context, loads: Sequence[float]) -> tuple[Table, str]:
    """Return the table of fast wrist motion and the conclusions from it."""
    motion = wrist(context.tested)
    speed = float(np.degrees(np.abs(np.diff(motion)).max() / TIME_STEP))

    def column(heading: str, name: str, unit: str, description: str) -> Column:
        key = f"compensated_cycles.wrist.{name}.{{by.key}}.at_{{force:g}}N"
        return Column(heading, key, unit, f"{description}, fast wrist motion, {{by.name}}, {{force:g}} N")

    table = context.table(
        f"Fast wrist motion: sines of 0.5 to 2 Hz, up to {speed:.0f}°/s, {_WRIST_PERIODS} periods of "
        f"{_WRIST_PERIOD:g} s; growth of the RMSE and of the mean tension from the first {_ENDS} to the last {_ENDS}",
        "load and law",
        column("RMSE [°]", "rmse", "deg", "RMSE of the tip against eq. 18"),
        "largest [°]",
        column("RMSE, end over start", "growth", "1", "RMSE over the last three periods, over that of the first three"),
        "mean tension at start [N]",
        "at end [N]",
        column("growth [N]", "mean_tension_growth", "N", "Growth of the mean tension"),
        "fault",
    )
    found = _tracked(context.tested, motion, loads, (OFF, ROBUST), _WRIST_PERIOD)
    for (force, compensation), done in found.items():
        table.row(
            f"{force:g} N, {compensation.name}",
            done.rmse,
            done.largest,
            done.growth,
            done.mean_at_start,
            done.mean_at_end,
            done.mean_at_end - done.mean_at_start,
            "yes" if done.run["faults"].any() else "no",
            by=compensation,
            force=force,
        )
    robust = [done for (_, compensation), done in found.items() if compensation is ROBUST]
    if not robust:
        return table, ""
    grown = max(abs(done.growth - 1) for done in robust)
    tightened = max(abs(done.mean_at_end - done.mean_at_start) for done in robust)
    return table, (
        f"<p>In fast wrist motion the robust law’s error changes by {100 * grown:.0f} % at most from the start to "
        f"the end of {_WRIST_PERIODS} periods, and the mean tension by {round(tightened, 9):.2g} N.</p>"
    )


def _span(values: Sequence[float]) -> str:
    low, high = (f"{value:.1f}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _plot(context: Context, loads: Sequence[float], found: Found) -> Plot:
    inst = context.tested
    chart = Chart(Figure(figsize=(3.1 * len(loads) + 0.6, 3.8), layout="constrained"))
    axes = list(chart.figure.subplots(1, len(loads), squeeze=False, sharey=True)[0])
    last = slice(-round(_PERIOD / TIME_STEP), None)
    for axis, force in zip(axes, loads, strict=True):
        for each in COMPENSATIONS:
            done, at = found[force, each], f"{each.key} at {force:g} N [deg]"
            handle = chart.keep(f"handle_angle {at}", np.degrees(done.run["handle_angle"][last][DRAWN]))
            chart.curve(axis, handle, f"error {at}", np.degrees(done.error[last][DRAWN]), color=each.color, lw=1.2)
        axis.axhline(0, color=style.INK, ls="--", lw=0.8)
        axis.set(title=f"{force:g} N", xlabel="handle angle $\\theta_h$ [deg]")
    axes[0].set_ylabel("off the unloaded angle [deg]")
    style.legend_outside(chart.figure, *((each.name, each.color, "-") for each in COMPENSATIONS))
    return chart.plot(
        context.file_name("fig14", "compensated" + "_cycles" * context.is_own),
        f"Error of the tip against its unloaded angle (eq. 18) over the handle’s angle, {named(inst)}, "
        f"T<sub>o</sub> = {inst.pretension:g} N, the last of {_CYCLES} cycles of "
        f"0–{np.degrees(amplitude(inst)):.3g}° at {_FREQUENCY:g} Hz"
        f"{context.figure_of('Fig. 14', ' without compensation')}.",
    )
