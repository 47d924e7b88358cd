"""Motions there and back under load with compensation: how well the joints follow that a controller serves (Fig. 14).

Of a planar instrument also fast wrist motion.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tenodesis import control, statics
from tenodesis.control import Controller, LawName
from tenodesis.instrument import ShortForm
from tenodesis.paper import step_response
from tenodesis.paper.compensated_step import controller_of, served
from tenodesis.paper.context import DRAWN, Context, RecordedRun, has_friction
from tenodesis.paper.cycles import LOADING as LOADED
from tenodesis.paper.cycles import RESTING as RESTED
from tenodesis.paper.cycles import SEED, protocol
from tenodesis.paper.subject import FarMotion, Load, Subject
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Plot, ResultColumn, Section, Table, fixed, named
from tenodesis.report.curves import forces
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
    """The error of the joint that follows against its unloaded angle (eq. 18) while it moves under load."""

    handle: Array
    """Handle angle of the last cycle, thinned, (n,), deg"""
    off: Array
    """Error there, (n,), deg"""
    rmse: float
    """deg"""
    largest: float
    """deg"""
    growth: float = 1.0
    """Ratio of the error at the end to that at the start."""
    means: tuple[float, float] = (np.nan, np.nan)
    """Mean tension of both tendons at the start and at the end, N."""
    after_reversal: float = np.nan
    """Share of the squared error that falls in the time after the handle has reversed."""
    faulted: bool = False


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
    error = np.degrees(run["output_angle"] - statics.output_angle(inst, handle))[first:]
    mean = run["tension"].mean(1)[first:]
    part = round(min(_ENDS * period / TIME_STEP, error.size / 2))
    last = slice(-round(period / TIME_STEP), None)
    squares = error.reshape(-1, round(period / TIME_STEP) // 2) ** 2
    return Tracking(
        np.degrees(run["handle_angle"][last][DRAWN]),
        error[last][DRAWN],
        campaign.rms(error),
        campaign.farthest(error),
        campaign.rms(error[-part:]) / campaign.rms(error[:part]),
        (float(mean[:part].mean()), float(mean[-part:].mean())),
        float(squares[:, : round(_AFTER_REVERSAL / TIME_STEP)].sum() / squares.sum()),
        bool(run["faults"].any()),
    )


def follow(subject: Subject, motion: FarMotion, load: Load, law: str) -> Tracking | None:
    """Run cycles of a motion of several joints; None if the joints cannot hold the load."""
    done = RecordedRun.of(
        subject.given, protocol(subject, motion, load), SEED, controller_of(control.compensated(subject.given), law)
    )
    if done is None:
        return None
    shown = done.run.rows(round((LOADED + RESTED) / TIME_STEP), None, DRAWN.step)
    last = shown.rows(len(shown) // 2)
    handle = last.by_column("handle_angle")
    error = np.degrees(subject.turned(last) - subject.angles(handle))[:, motion.follows]
    moved = np.degrees(handle[:, motion.driven[1]])
    return Tracking(moved, error, campaign.rms(error), campaign.farthest(error))


Case = tuple[str, str]
"""Motion, empty of a planar instrument, and load in words."""
Found = dict[tuple[Case, Compensation], Tracking]


def _tracked(
    inst: ShortForm, motion: Array, loads: Sequence[float], compensations: Sequence[Compensation], period: float
) -> Found:
    """Return the motion under each force, N, with each compensation, as far as the joint holds it."""

    def trial(force: float, compensation: Compensation) -> dict[str, Tracking]:
        return {"tracking": track(inst, motion, force, compensation, period)}

    rows = campaign.run(trial, campaign.cases(force=loads, compensation=compensations), on="threads")
    return {(("", f"{row['force']:g} N"), row["compensation"]): row["tracking"] for row in rows}


def _followed(subject: Subject) -> Found:
    """Return every motion of a joint that a controller serves under the load that takes most of it."""
    motions = [motion for motion in subject.motions if motion.follows in served(subject).values()]

    def trial(motion: FarMotion, compensation: Compensation) -> dict[str, Tracking] | None:
        found = follow(subject, motion, subject.most_taking(motion.follows), compensation.law)
        return None if found is None else {"tracking": found}

    rows = campaign.run(trial, campaign.cases(motion=motions, compensation=(OFF, ROBUST)), on="threads")
    loads = {motion.name: subject.most_taking(motion.follows).text for motion in motions}
    return {((row["motion"].name, loads[row["motion"].name]), row["compensation"]): row["tracking"] for row in rows}


def section(context: Context) -> Section:
    """Compute the cycles under the loads of the instrument, and of a planar one fast wrist motion."""
    subject = context.bench
    if (inst := subject.plane) is not None and (why := step_response.missing(inst)):
        return Section.not_run("compensated_cycles", TITLE, why)
    used = COMPENSATIONS if inst is not None else (OFF, ROBUST)
    found = _followed(subject) if inst is None else _tracked(inst, cycles(inst), forces(inst)[1:], used, _PERIOD)
    cases = [case for case in dict.fromkeys(case for case, _ in found) if all((case, each) in found for each in used)]
    if not cases:
        why = f"{named(subject.given)} holds no load while its handle moves"
        return Section.not_run("compensated_cycles", TITLE, why)
    table, text = _cycles(context, cases, found, used)
    tables = [table]
    if inst is not None:
        loads = forces(inst)[1:]
        held = [force for force in loads if ("", f"{force:g} N") in cases]
        wrist_table, more = _fast_wrist(context, [0.0, held[min(1, len(held) - 1)]])
        tables.append(wrist_table)
        text += more
    return Section("compensated_cycles", TITLE, text, [_plot(context, cases, found, used)], tables)


def _cycles(context: Context, cases: Sequence[Case], found: Found, used: Sequence[Compensation]) -> tuple[Table, str]:
    """Return the table of the cycles and the conclusions from it."""
    planar = context.bench.plane is not None
    rivals = {
        OFF: ("no compensation", "vs none", RATIO_TO_OFF),
        ONE_MOTOR: ("eq. 22 by one motor", "vs one motor", RATIO_TO_PAPER),
        BOTH_MOTORS: ("eq. 22 by both motors", "vs both", RATIO_TO_PAPER),
    }
    rivals = {rival: words for rival, words in rivals.items() if rival in used}

    def column(heading: str, name: str, about: str, unit: str = "deg", **look: Any) -> ResultColumn:
        return ResultColumn(heading, f"compensated_cycles.{name}.{{case}}", unit, f"{about}, {{words}}", **look)

    which = (
        f"cycles 2 to {_CYCLES} of 0–{np.degrees(amplitude(context.tested)):.3g}° at {_FREQUENCY:g} Hz"
        if planar
        else "the last cycle of each motion above"
    )
    who = "tip" if planar else "joint that follows"
    table = context.table(
        f"RMSE of the {who} against its unloaded angle (eq. 18) [°] over {which}, its largest error, and by how many "
        "times the robust law’s RMSE is smaller" + ", and the mean tension of both tendons" * planar,
        *["motion"] * (not planar),
        "load",
        *(
            column(each.name, f"rmse.{each.key}", f"RMSE of the {who} against eq. 18 over the cycles, {each.name}")
            for each in used
        ),
        *[column("off, largest [°]", "largest.off", f"Largest error of the {who} without compensation")] * (not planar),
        column("robust, largest [°]", "largest", f"Largest error of the {who} under the robust law"),
        *(
            column(
                short if context.is_own else f"{short} (≥&nbsp;{least:g})",
                f"ratio.{rival.key}",
                f"RMSE of {name} over that of the robust law",
                "1",
                form=partial(fixed, decimals=1) if context.is_own else partial(_judged, least=least),
            )
            for rival, (name, short, least) in rivals.items()
        ),
        *["mean tension, start → end [N]"] * planar,
    )
    ratios: dict[Compensation, list[float]] = {rival: [] for rival in rivals}
    for case in cases:
        motion, load = case
        robust = found[case, ROBUST]
        for rival, values in ratios.items():
            values.append(found[case, rival].rmse / robust.rmse)
        table.row(
            *[motion] * (not planar),
            load,
            *(found[case, each].rmse for each in used),
            *[found[case, OFF].largest] * (not planar),
            robust.largest,
            *(values[-1] for values in ratios.values()),
            *[" → ".join(fixed(mean, 1) for mean in robust.means)] * planar,
            case=motion or f"at_{load.replace(' ', '')}",
            words=", ".join(filter(None, case)),
        )
    as_printed = "" if context.is_own else " as in the paper,"
    text = (
        "<p>The handle moves back and forth under a constant load with the controller enabled. The robust law’s RMSE "
        f"is {_smaller(ratios[OFF])} without compensation"
    )
    if planar:
        text += (
            f", {_smaller(ratios[ONE_MOTOR])} with the law “paper” (eq. 22){as_printed} by the "
            f"agonist’s motor, and {_smaller(ratios[BOTH_MOTORS])} with it by both motors"
        )
    text += ".</p>"
    missed = any(min(ratios[rival]) < least for rival, (_, _, least) in rivals.items())
    if planar and has_friction(context.tested) and (context.is_own or missed):
        share = np.mean([found[case, ROBUST].after_reversal for case in cases])
        text += (
            f"<p>{'' if context.is_own else 'Where a ratio is missed: '}{100 * share:.0f} % of the robust law’s "
            f"squared error falls in the {_AFTER_REVERSAL:g} s after the handle has reversed. There friction changes "
            "its direction at every contact, and until the motors have wound through the friction bands the tip stands "
            "while the handle moves on.</p>"
        )
    return table, text


def _judged(ratio: float, least: float) -> str:
    return f"{fixed(ratio, 1)} {'met' if ratio >= least else 'missed'}"


def _fast_wrist(context: Context, loads: Sequence[float]) -> tuple[Table, str]:
    """Return the table of fast wrist motion and the conclusions from it."""
    motion = wrist(context.tested)
    speed = float(np.degrees(np.abs(np.diff(motion)).max() / TIME_STEP))

    def column(heading: str, name: str, unit: str, description: str) -> ResultColumn:
        key = f"compensated_cycles.wrist.{name}.{{by.key}}.at_{{at}}"
        return ResultColumn(heading, key, unit, f"{description}, fast wrist motion, {{by.name}}, {{load}}")

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
    for ((_, load), compensation), done in found.items():
        start, end = done.means
        cells = done.rmse, done.largest, done.growth, start, end, end - start, "yes" if done.faulted else "no"
        table.row(f"{load}, {compensation.name}", *cells, by=compensation, load=load, at=load.replace(" ", ""))
    robust = [done for (_, compensation), done in found.items() if compensation is ROBUST]
    if not robust:
        return table, ""
    grown = max(abs(done.growth - 1) for done in robust)
    tightened = max(abs(np.subtract(*done.means)) for done in robust)
    return table, (
        f"<p>In fast wrist motion the robust law’s error changes by {100 * grown:.0f} % at most from the start to "
        f"the end of {_WRIST_PERIODS} periods, and the mean tension by {round(tightened, 9):.2g} N.</p>"
    )


def _span(values: Sequence[float]) -> str:
    low, high = (f"{value:.1f}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _smaller(ratios: Sequence[float]) -> str:
    """Return how many times smaller an error is than others, or larger, from the ratios of those to it."""
    inverse = [1 / ratio for ratio in ratios]
    if min(ratios) >= 1:
        return f"{_span(ratios)} times smaller than"
    if max(ratios) <= 1:
        return f"{_span(inverse)} times larger than"
    return f"from {max(inverse):.1f} times larger to {max(ratios):.1f} times smaller than"


def _plot(context: Context, cases: Sequence[Case], found: Found, used: Sequence[Compensation]) -> Plot:
    inst, planar = context.bench.given, context.bench.plane is not None
    chart = Chart(Figure(figsize=(max(3.1 * len(cases) + 0.6, 0 if planar else 7.0), 3.8), layout="constrained"))
    axes = list(chart.figure.subplots(1, len(cases), squeeze=False, sharey=planar)[0])
    for axis, case in zip(axes, cases, strict=True):
        motion, load = case
        for each in used:
            done = found[case, each]
            at = f"{motion}, {each.key} [deg]" if motion else f"{each.key} at {load} [deg]"
            handle = chart.keep(at if motion else f"handle_angle {at}", done.handle)
            chart.curve(axis, handle, f"error {'by ' * bool(motion)}{at}", done.off, color=each.color, lw=1.2)
        axis.axhline(0, color=style.INK, ls="--", lw=0.8)
        axis.set(title=load, xlabel=f"{motion} [deg]" if motion else "handle angle $\\theta_h$ [deg]")
    axes[0].set_ylabel("off the unloaded angle [deg]")
    style.legend_outside(chart.figure, *((each.name, each.color, "-") for each in used))
    if not planar:
        about = f"Error of the joint that follows over the handle’s angle, {named(inst)} under load on the twin."
        return chart.plot("compensated_cycles", about)
    return chart.plot(
        context.file_name("fig14", "compensated" + "_cycles" * context.is_own),
        f"Error of the tip against its unloaded angle (eq. 18) over the handle’s angle, {named(inst)}, "
        f"T<sub>o</sub> = {inst.pretension:g} N, the last of {_CYCLES} cycles of "
        f"0–{np.degrees(amplitude(context.tested)):.3g}° at {_FREQUENCY:g} Hz"
        f"{context.figure_of('Fig. 14', ' without compensation')}.",
    )
