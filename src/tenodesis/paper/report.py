"""The page of the report: a self-contained HTML file."""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from tenodesis.control.plausibility import implausible
from tenodesis.control.resolution import sentences, warnings
from tenodesis.instrument import Instrument
from tenodesis.paper.context import Context, shown_force
from tenodesis.report import page
from tenodesis.report.content import Section, fixed, unit_text
from tenodesis.units import in_unit


def headlines(context: Context) -> list[tuple[str, str]]:
    """Return the few results at the top of the page, each with its meaning."""
    results = context.results
    chosen = [
        ("loss.flexural_stiffness.straight", "flexural stiffness, straight", 3),
        ("tension.slack_load.flexed", "load under which a tendon goes slack, handle held", 2),
        ("transmissibility.straight", "torque transmissibility, straight", 3),
        ("axes.loaded_coupling", "largest coupling of yaw and pitch", 1),
        ("loss.largest", "largest loss of a joint", 1),
        ("slack.least", "least load at which a tendon goes slack", 2),
        ("stiffness.softest", "stiffness, softest motion", 3),
        ("hysteresis.widest", "widest loop on the twin", 1),
        ("compensated.robust.worst", "left by the robust law, at most", 2),
    ]
    if context.short is not None:
        flexed, force = np.degrees(context.inst.output_range), shown_force(context.inst)
        chosen.insert(0, (f"loss.at_{flexed:.4g}deg.{force:g}N", f"lost under {force:g} N at {flexed:.4g}°", 1))
    units = {"deg": "°", "1": ""}
    return [
        (name, fixed(results[key].value, digits) + units.get(results[key].unit, f" {results[key].unit}"))
        for key, name, digits in chosen
        if key in results
    ]


def render(context: Context, sections: Sequence[Section], drawings: Mapping[str, Markup]) -> str:
    """Return the report as HTML; drawings are the figures as SVG, by name."""
    instruments = [inst for inst in (context.given, context.scaled) if inst is not None]
    scaled = None if context.scaled is None else context.scaled.short_form
    sensing = (context.short or context.controlled, scaled)
    return page.render(
        __package__,
        "report.html.j2",
        inst=context.given,
        kind=_kind(context),
        scaled=context.scaled,
        own=context.is_own,
        implausible=_implausible(context),
        headlines=headlines(context),
        dimensions=[_dimensions(inst) for inst in instruments],
        resolutions=[(inst.name, " ".join((*sentences(inst), *warnings(inst)))) for inst in sensing if inst],
        sections=sections,
        left_out=context.left_out,
        drawings=drawings,
        care=sorted((point for section in sections for point in section.care), key=lambda point: point.number),
        published=[result for result in context.results.values() if result.published is not None],
        marked=_marked,
    )


def _implausible(context: Context) -> list[str]:
    """Return what is implausible about an instrument of one's own; its sensors have a sentence already."""
    if not context.is_own:
        return []
    found = implausible(context.given)
    return [unit_text(one.sentence) for one in found if one.key != "sensors"]


def _kind(context: Context) -> str:
    """Return in words what joints the instrument has."""
    if context.short is not None:
        return f"{context.short.joint_type} joint, {' and '.join(context.short.axes)}"
    *names, last = context.subject.joints
    return f"joints {', '.join(names)}{' and ' * bool(names)}{last} by {len(context.whole.tendons)} tendons"


def _marked(text: str) -> Markup:
    """Return text as HTML, its symbols with their subscripts lowered."""
    return Markup(re.sub(r"(?<![\w])([θκTlF])_([a-zθ])(?![a-z])", r"\1<sub>\2</sub>", text))


def _dimensions(inst: Instrument) -> tuple[str, list[tuple[str, str, str]]]:
    """Return an instrument's name and its values as text, each with its source."""
    units = {"m": "mm", "Pa": "GPa", "rad": "deg", "N*m^2": "N*mm^2"}
    rows = []
    for key, value, quantity in inst.quantities():
        unit = units.get(quantity.unit, quantity.unit)
        shown = f"{value * in_unit(unit, quantity.unit):.5g} {unit_text(unit)}"
        source = "follows from E A / L" if key == "tendon_stiffness" and inst.given_stiffness is None else ""
        rows.append((key.replace("_", " "), shown.replace(" deg", "°"), inst.sources.get(key, source)))
    forces = ", ".join(f"{force:g}" for force in inst.conditions.forces)
    if forces:
        rows.append(("forces", f"{forces} N", inst.sources.get("conditions.forces", "")))
    return inst.name, rows
