"""The report: one HTML file that needs nothing beside it."""

import re
from collections.abc import Mapping, Sequence
from importlib import resources

import jinja2
import numpy as np
from markupsafe import Markup

from tenodesis.bench.content import Context, Section, fixed
from tenodesis.instrument import Instrument
from tenodesis.quantity import in_unit

_TEMPLATE = "report.html.j2"


def headlines(context: Context) -> list[tuple[str, str]]:
    """Return the few numbers that stand first, with what they are."""
    results = context.results
    chosen = [
        ("loss.flexural_stiffness.straight", "flexural stiffness, straight", 3),
        ("tension.slack_force.flexed", "load at which a tendon goes slack", 2),
        ("transmissibility.straight", "torque transmissibility, straight", 3),
        ("axes.loaded_coupling", "yaw and pitch disturb each other by up to", 1),
    ]
    worst = [key for key in results if key.startswith("loss.at_")][: 3 * 2]
    if worst:
        chosen.insert(0, (worst[-1], results[worst[-1]].description.lower(), 1))
    return [
        (name, f"{fixed(results[key].value, digits)} {results[key].unit.replace('deg', '°').rstrip('1')}".strip())
        for key, name, digits in chosen
        if key in results
    ]


def render(
    context: Context, sections: Sequence[Section], drawings: Mapping[str, str], about: Mapping[str, str]
) -> str:
    """Return the report as HTML; drawings are the figures as SVG, by name."""
    text = (resources.files("tenodesis.bench") / _TEMPLATE).read_text("utf-8")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string(text)
    care = sorted((point for section in sections for point in section.care), key=lambda point: point.number)
    return template.render(
        inst=context.inst,
        scaled=context.scaled,
        is_paper=context.is_paper,
        headlines=headlines(context),
        dimensions=[_dimensions(inst) for inst in (context.inst, context.scaled) if inst is not None],
        sections=sections,
        drawings={name: Markup(_inline(name, svg)) for name, svg in drawings.items()},
        care=care,
        published=[result for result in context.results.values() if result.published is not None],
        about=about,
        fixed=fixed,
        safe=Markup,
    )


def _inline(name: str, svg: str) -> str:
    """Return an SVG to stand within HTML: without its prologue, and with ids that no other figure uses."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', body)
    body = re.sub(r'(xlink:href="#|url\(#)', rf"\1{name}-", body)
    return re.sub(r'^<svg[^>]*?width="[^"]+" height="[^"]+"', lambda m: re.sub(r' (width|height)="[^"]+"', "", m[0]), body)


def _dimensions(inst: Instrument) -> tuple[str, list[tuple[str, str, str]]]:
    """Return an instrument's name and its values as text, each with its source."""
    units = {"m": "mm", "Pa": "GPa", "N": "N", "rad": "deg", "N/m": "N/m", "N*m^2": "N*mm^2"}
    rows = []
    for key, field in type(inst).model_fields.items():
        quantity = next((item for item in field.metadata if hasattr(item, "unit")), None)
        value = getattr(inst, key)
        if quantity is None or value is None:
            continue
        unit = units[quantity.unit]
        shown = f"{value * in_unit(unit, quantity.unit):.5g} {unit.replace('*', '·').replace('^2', '²')}"
        label = (field.alias or key).replace("_", " ")
        rows.append((label, shown.replace(" deg", "°"), inst.sources.get(field.alias or key, "")))
    if inst.given_stiffness is None:
        rows.append(("tendon stiffness", f"{inst.tendon_stiffness:.0f} N/m", "E A / L"))
    forces = ", ".join(f"{force:g}" for force in inst.conditions.forces)
    if forces:
        rows.append(("forces", f"{forces} N", inst.sources.get("conditions.forces", "")))
    return inst.name, rows


def largest_residual(context: Context) -> float:
    """Return the largest relative residual of the published scale factors."""
    ratios = [
        abs(result.residual / result.published.value)
        for result in context.results.values()
        if result.published is not None and result.residual is not None and result.key.startswith("table")
    ]
    return float(np.max(ratios, initial=0.0))
