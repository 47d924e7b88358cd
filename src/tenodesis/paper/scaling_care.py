"""Where the paper needs care about its scale model: care points 4 to 8."""

import numpy as np

from tenodesis import statics
from tenodesis.instrument import Instrument, TendonGear
from tenodesis.paper.context import Context
from tenodesis.paper.published import CAPTION_FORCE, EQUIVALENT_FORCE, STATES, TIP_FORCE
from tenodesis.report.content import CarePoint, fixed, number
from tenodesis.similarity import Comparison


def care_points(context: Context, comparison: Comparison) -> list[CarePoint]:
    """Return the care points that come with the scale model."""
    return [
        _one_angle(context, comparison),
        _pretension(context, comparison),
        _pairs(context, comparison.scaled_up),
        _cable(context, comparison),
        _stiffness(context, comparison),
    ]


def _one_angle(context: Context, comparison: Comparison) -> CarePoint:
    at = [context.results[f"table2.force_factor.at_{angle}deg"].value for angle in (0, 40, 80)]
    slenderness = next(group for group in comparison.groups if group.name == "l_d/r")
    return CarePoint(
        4,
        "Similarity is exact at one angle only",
        f"l_d/r differs ({number(slenderness.real_size, 3)} against {number(slenderness.scaled_up, 3)}), so the force "
        f"factor for equal Θ runs from {fixed(at[0], 3)} at 0° over {fixed(at[1], 3)} at 40° to "
        f"{fixed(at[2], 3)} at 80°; the table's 2.88 is mid-range.",
    )


def _pretension(context: Context, comparison: Comparison) -> CarePoint:
    scaled = context.add(
        "care.5.scaled_pretension",
        comparison.real_size.pretension * comparison.tension_factor,
        "N",
        "Pretension of the scaled-up instrument that is similar to the real-size one's",
    )
    small, large = (
        float(statics.slack_force(inst, inst.output_range)) for inst in (comparison.real_size, comparison.scaled_up)
    )
    meant = large / float(comparison.force_factor())
    context.add("care.5.slack_force.real", small, "N", "Force at slack onset at 80 deg, real-size")
    context.add("care.5.slack_force.as_used", meant, "N", "The same by the scaled-up one at 25 N, scaled down")
    used, similar = comparison.errors["as used"], comparison.errors["scaled"]
    return CarePoint(
        5,
        "Pretension must scale too",
        f"{comparison.real_size.pretension:g} N on the real-size instrument is {fixed(scaled, 1)} N on the scaled-up "
        f"one; the experiments used {comparison.scaled_up.pretension:g} N. Slack then begins at what would be "
        f"{fixed(meant)} N at 80° instead of {fixed(small)} N, and the rms similarity error up to "
        f"{comparison.largest_force:g} N grows from {fixed(similar.rms, 2)}° to {fixed(used.rms, 2)}°. Up to "
        f"{EQUIVALENT_FORCE.value} N, where Fig. 14 was taken, no tendon goes slack and without friction it makes no "
        "difference; friction grows with tension, so that with it even there it does.",
    )


def _pairs(context: Context, scaled: Instrument) -> CarePoint:
    sentences = []
    for handle, output in STATES[1:]:
        follows = float(np.degrees(statics.output_angle(scaled, np.radians(handle.value))))
        needs = float(np.degrees(statics.handle_angle(scaled, np.radians(output.value))))
        key = f"care.6.at_{output.value:.4g}deg"
        context.add(
            f"{key}.output",
            follows,
            "deg",
            f"Output at the published handle angle {handle.value:g} deg",
            output,
        )
        context.add(f"{key}.handle", needs, "deg", f"Handle angle that gives {output.value:g} deg", handle)
        sentences.append(
            f"{handle.value:g}° → {output.value:g}° published, {fixed(follows, 1)}° by eq. 18; "
            f"{output.value:g}° needs {fixed(needs, 1)}°"
        )
    return CarePoint(
        6,
        "The angle pairs of Fig. 15 contradict eq. 18",
        f"{'. '.join(sentences)}. We reproduce the four states by output angle.",
    )


def _cable(context: Context, comparison: Comparison) -> CarePoint:
    conditions = comparison.scaled_up.conditions
    moment = float(conditions.cable_force or 0) * float(conditions.cable_pulley_radius or 0)
    assert isinstance(comparison.scaled_up, TendonGear)
    lever = comparison.scaled_up.end_effector_length + 2 * comparison.scaled_up.distal_gear_radius
    tip = context.add(
        "care.7.tip_force", moment / lever, "N", "Force at the scaled-up tip from 10 N on a cable", TIP_FORCE
    )
    factor = float(comparison.force_factor())
    real = context.add(
        "care.7.real_force",
        TIP_FORCE.value / factor,
        "N",
        "Real-size force that 1.5 N stands for",
        EQUIVALENT_FORCE,
    )
    return CarePoint(
        7,
        "10 N on a weight cable are not 1.5 N on the real-size instrument",
        f"10 N on the cable at {1e3 * float(conditions.cable_pulley_radius or 0):g} mm are {fixed(moment)} N·m, over "
        f"l_d + 2r = {1e3 * lever:.0f} mm that is {fixed(tip)} N at the scaled-up tip (published: {TIP_FORCE.value} "
        f"N), and 1.5 N there stand for {fixed(real)} N on the real-size instrument (published: "
        f"{EQUIVALENT_FORCE.value} N). The {CAPTION_FORCE.source} says {CAPTION_FORCE.value} N; the text is right.",
    )


def _stiffness(context: Context, comparison: Comparison) -> CarePoint:
    small, large = (inst.tendon_stiffness for inst in (comparison.real_size, comparison.scaled_up))
    return CarePoint(
        8,
        "Table I's stiffnesses follow from E A / L",
        f"With L the overall length they come out at {small:.0f} and {large:.0f} N/m (published: 31172 and 11451); the "
        "files give diameter, modulus and length, not stiffness.",
    )
