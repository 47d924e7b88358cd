"""The laws on instruments that differ from the controller's model: contacts, compliance, friction, calibration."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tenodesis.control import LawName, homing_failure
from tenodesis.instrument import ShortForm
from tenodesis.paper import step_response
from tenodesis.paper.compensated_step import FRICTION_ERRORS
from tenodesis.paper.context import Context
from tenodesis.paper.step_load import step_force
from tenodesis.report import style
from tenodesis.report.content import Chart, Plot, Section, Table, fixed, named
from tenodesis.run import Run
from tenodesis.simulate.campaign import Rows, farthest, rms
from tenodesis.twin import TIME_STEP

TITLE = "Instruments unlike the controller’s model"
_HOMING, _BEFORE, _AFTER, _SEED = 7.0, 2.0, 8.0, 17  # s, s, s
_LAWS: dict[LawName, str] = {"off": "motors off", "paper": "eq. 22, both motors", "robust": "robust law"}
_TARGETS = (0.3, 0.7, 3.0)  # deg, deg, s
_ROUGH = 2.5
_FRONT = 0.55
_BASE = 0.03
_SOFT = 0.85
_GAIN, _OFFSET = 0.02, 0.02
_JUDGED = 2.0  # s, at the end


class PlantDifference(NamedTuple):
    """A difference between an instrument and the controller's model of it."""

    key: str
    name: str
    unknown: Mapping[str, Any] = {}
    """What the instrument has and the controller does not know, by key of the file."""
    known: Mapping[str, Any] = {}
    """What both have."""
    homes: bool = False
    """Whether the controller homes first, which finds errors of the load cells."""


def differences(inst: ShortForm) -> list[PlantDifference]:
    """Return the differences for an instrument with friction, none first and all at once last."""
    friction = inst.friction
    # Exponents add up, so that a base exponent is a wrap angle that remains.
    base = {"friction.base_wrap": _BASE / friction.vertex_coefficient} if friction.vertex_coefficient else {}
    two = {"friction.vertices_per_joint": 2}
    front = {"friction.handle_compliance_share": _FRONT}
    soft = {"mismatch.stiffness_ratio": inst.mismatch.stiffness_ratio * _SOFT}
    rough = {
        f"friction.{name}": _ROUGH * getattr(friction, name) for name in ("vertex_coefficient", "sheath_coefficient")
    }
    gain, bias, offset = inst.mismatch.load_cell_gain, inst.mismatch.load_cell_bias, _OFFSET * inst.pretension
    gains = {"mismatch.load_cell_gain": (gain[0] * (1 + _GAIN), gain[1] * (1 - _GAIN))}
    offsets = {"mismatch.load_cell_bias": (bias[0] + offset, bias[1] - offset)}
    percent = f"{100 * _GAIN:g} %"
    found = [
        PlantDifference("none", "nothing"),
        PlantDifference("two_vertices", "two vertices a joint", two),
        PlantDifference("compliance", f"{100 * _FRONT:g} % of the compliance before the handle’s joint", front),
        PlantDifference("softer", f"tendons {100 * (1 - _SOFT):.0f} % softer", soft),
        PlantDifference("rougher", f"coefficients {_ROUGH:g} times those of the file, known", known=rough),
        PlantDifference("gains", f"gains of the load cells off by ±{percent}, not homed", gains),
        PlantDifference("gains_homed", f"gains of the load cells off by ±{percent}, homed", gains, homes=True),
        PlantDifference("offsets", f"load cells off by ±{percent} of the pretension, not homed", offsets),
        PlantDifference("offsets_homed", f"load cells off by ±{percent} of the pretension, homed", offsets, homes=True),
    ]
    if base:
        found.insert(3, PlantDifference("base", f"exponent {_BASE:g} that remains at a straight joint", base))
    every = {**two, **front, **base, **soft, **gains, **offsets}
    found.append(PlantDifference("all", "all at once, homed", every, rough, homes=True))
    return found


def held(
    inst: ShortForm,
    difference: PlantDifference,
    laws: Mapping[LawName, Sequence[float]],
    times: tuple[float, float],
    measure: Callable[..., Mapping[str, Any]],
    **how: Any,
) -> Rows:
    """Return :func:`tenodesis.paper.step_response.held` with a difference over the held states, under the step load."""
    given = inst.replace(**difference.known)
    states, load, plant = step_response.held_states(given), step_force(inst), difference.unknown
    return step_response.held(given, states, laws, times, measure, load=load, plant=given.replace(**plant), **how)


def outcomes(inst: ShortForm, difference: PlantDifference) -> Rows:
    """Run the laws over the held states of an instrument, the robust one over the errors of its assumed friction.

    A row has the response of the tip, the mean square of the estimate's error over its variance (normalised), and why
    homing refused, in the words of :func:`tenodesis.control.homing_failure`; empty if it did not.
    """
    wait = _HOMING if difference.homes else 0.0

    def measure(run: Callable[..., Run], motion: step_response.HeldMotion, _: ShortForm) -> dict[str, Any]:
        done = run(homed=round(wait / TIME_STEP) or None)
        last = done.rows(-round(_JUDGED / TIME_STEP))
        off = (last["estimated_output_angle"] - last["output_angle"]) / last["estimated_output_angle_std"]
        refused = homing_failure(int(np.nan_to_num(done["homing_failure"][-1])))
        normalised = float(np.mean(off**2))
        return step_response.response(done, motion)._asdict() | {"normalised": normalised, "refused": refused}

    laws = {law: FRICTION_ERRORS if law == "robust" else (0.0,) for law in _LAWS}
    return held(inst, difference, laws, (_BEFORE, _AFTER), measure, seeds=(_SEED,), wait=wait)


def section(context: Context) -> Section:
    """Compute the final errors without compensation, with the paper's law and with the robust law, by difference."""
    inst = context.tested
    if why := step_response.missing(inst, seeds=context.seeds, rough=True):
        return Section.not_run("unlike_model", TITLE, why)
    rows, bars = [], []
    for difference in differences(inst):
        rows_of = outcomes(inst, difference)
        found = rows_of.by("law")
        if len(found) < len(_LAWS):
            continue
        refused = sorted({*rows_of["refused"]} - {""})
        if refused:
            why = f"homing refuses: {', '.join(refused)}"
            rows.append([difference.name, *("–" for _ in range(len(_LAWS) - 1)), why, *("–" for _ in _TARGETS)])
            continue
        rows.append(_row(context, difference, found))
        bars.append((difference.name, [rms(found[law]["final"]) for law in _LAWS]))
    if not rows:
        return Section.not_run("unlike_model", TITLE, f"{named(inst)} does not hold the load in any state")
    table = Table(
        f"Final error of the tip after a step load of {step_force(inst):.3g} N, by what differs from the "
        "controller’s model",
        [
            "what differs",
            *(f"{name}, RMS / worst [°]" for law, name in _LAWS.items() if law != "robust"),
            *(
                heading if context.is_own else f"{heading}, target {target:g}"
                for heading, target in zip(
                    ("robust law, RMS [°]", "worst [°]", "time to within 1° [s]"), _TARGETS, strict=True
                )
            ),
            "normalised error squared",
        ],
        rows,
    )
    text = (
        "<p>The controller’s model is the instrument’s file. Here the instrument has one thing more, which the "
        "controller does not know unless the row says so. Homing, with a free tip, finds the offsets of the load "
        "cells, which they read of slack tendons, and the difference of their gains, since both tendons are stretched "
        "alike. Each cell is over the held states; the robust law also over friction assumed 30 % too low, right and "
        "30 % too high. The last column is the mean of the squared error of the estimated output angle over its own "
        "variance in the last two seconds: about 1 if that variance is right, less if it is too large.</p>"
    )
    return Section("unlike_model", TITLE, text, [_plot(inst, bars)], [table])


def _row(context: Context, difference: PlantDifference, found: Mapping[LawName, Rows]) -> list[str]:
    """Return the cells of a difference, and record its results."""
    cells = [difference.name]
    for law, name in _LAWS.items():
        finals = found[law]["final"]
        values = {"rms": rms(finals), "worst": farthest(finals)}
        for key, value in values.items():
            context.add(
                f"unlike_model.{difference.key}.{law}.final_error_{key}",
                value,
                "deg",
                f"{'RMS' if key == 'rms' else 'Largest'} final tip error, {name}; differs from the model: "
                f"{difference.name}",
            )
        if law != "robust":
            cells.append(f"{fixed(values['rms'])} / {fixed(values['worst'])}")
            continue
        time = float(found[law]["settling_time"].max())
        for value, target in zip((*values.values(), time), _TARGETS, strict=True):
            shown = fixed(value) if np.isfinite(value) else "never"
            cells.append(shown if context.is_own else f"{shown}, {'met' if value <= target else 'missed'}")
        cells.append(fixed(float(np.mean(found[law]["normalised"]))))
    return cells


def _plot(inst: ShortForm, bars: Sequence[tuple[str, Sequence[float]]]) -> Plot:
    chart, (axis,) = Chart.panels(height=0.9 + 0.5 * len(bars))
    laws = list(zip(_LAWS.values(), (style.MUTED, style.ANTAGONIST, style.AGONIST), strict=True))
    place = np.arange(len(bars))[::-1]
    width = 0.8 / len(_LAWS)
    chart.keep("row", place[::-1] + 1.0)
    for n, (name, color) in enumerate(laws):
        values = chart.keep(f"{name}: RMS [deg]", [row[n] for _, row in bars])
        drawn = axis.barh(place + (1 - n) * width, values, width * 0.9, color=color)
        axis.bar_label(drawn, fmt="%.2f", fontsize=7, padding=2)
    axis.set_yticks(place, [name for name, _ in bars], fontsize=8)
    axis.set(xlabel="final error, RMS [deg]")
    axis.margins(x=0.1)
    style.legend_outside(chart.figure, *((name, color, "-") for name, color in laws))
    return chart.plot(
        "unlike_model_errors",
        f"Final error of the tip under the step load, {named(inst)}, by what differs from the controller’s model.",
    )
