"""The checklist of a scale model's assembly, from rope to the controller, with the readings of this design."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from tenodesis.control.parameters import force_limit, tension_limit
from tenodesis.instrument import ShortForm
from tenodesis.scaling import Design
from tenodesis.scaling.plan import angle, plain, quantity
from tenodesis.workshop.budget import BACKLASHES, Budget
from tenodesis.workshop.first_run import CONTROLLED, FIRST_RUN, FirstRun
from tenodesis.workshop.order import SPARE_TURNS, rope_length
from tenodesis.workshop.words import NAMES, tolerance

HEADER, INSTRUMENT, LOG = "controller.h", "scaled-up.toml", "first-run.mcap"
_PROOF = 1.25  # of the controller's limit, as its fault of too much tension
_MASS = 1.0  # kg


class Step(NamedTuple):
    """A step of the assembly: what to do, and what must be seen before the next."""

    do: str
    see: str


def checklist(design: Design, budget: Budget, run: FirstRun) -> tuple[Step, ...]:
    """Return the steps from the parts on the table to a tip that the controller brings back."""
    inst = design.scaled_up.planar[0]
    limit, stretch = tension_limit(inst), 1e3 * inst.pretension / inst.tendon_stiffness
    proof = min(_PROOF * limit, design.choice.rope.breaking_load / 1.2)
    pull = 1e3 * _PROOF * inst.pretension / inst.tendon_stiffness
    diameter = inst.tendon_diameter or 0.0
    wound = math.degrees(inst.pretension / inst.tendon_stiffness / inst.drives.spool_radius)
    friction = inst.friction
    return (
        Step(
            "Measure every part with a tolerance, radii as diameters to the rope's centre (groove's bottom plus the "
            f"rope's {quantity(diameter, 'mm', 3, 'm')})",
            "; ".join(f"{NAMES[key]} {tolerance(one)}" for key, one in budget.dimensions.items() if one.is_drawn),
        ),
        *_meshing(inst, budget),
        Step(
            f"Cut the ropes to {quantity(rope_length(inst).total, 'mm', 5, 'm')}, crimp both ends, proof-load each for "
            "a minute",
            f"holds {quantity(proof, 'N', 3)}, no strand moves in its ferrule",
        ),
        Step(
            f"Pull test: load each rope to {quantity(_PROOF * inst.pretension, 'N', 3)} three times, read the third "
            "stretch; if it is off by more than its tolerance, give the rope with the modulus found in a "
            "catalogue of your "
            "own, and run tenodesis scale with it again",
            f"stretches {plain(pull, 3)} mm over {quantity(inst.tendon_length or inst.overall_length, 'mm', 5, 'm')} "
            f"({plain(inst.tendon_stiffness / 1e3, 4)} N/mm)",
        ),
        Step(
            "Thread from the end-effector: tip anchor, distal joint, stem, proximal joint, handle, sheath, load cell, "
            f"spool with {SPARE_TURNS} spare turns; agonist and antagonist are not to cross in the stem",
            "both run free by hand over the whole range, no kink at a vertex",
        ),
        Step(
            f"Hang {quantity(_MASS, 'kg', 3)} on each load cell, then nothing",
            f"reads {quantity(9.80665 * _MASS, 'N', 4)} and 0 N to {quantity(inst.sensors.load_cell_offset, 'N', 2)}; "
            f"range {quantity(inst.sensors.load_cell_range, 'N', 4)}, step "
            f"{quantity(inst.sensors.load_cell_range / 2**inst.sensors.load_cell_bits, 'N', 2)}",
        ),
        Step(
            "Clamp handle and tip straight on a flat, zero both encoders, move each by hand",
            f"0° to {angle(math.degrees(inst.sensors.encoder_offset))}; positive in flexion on both",
        ),
        Step(
            f"tenodesis check {INSTRUMENT}",
            f"no warning about tensions; tension limit {quantity(limit, 'N', 4)}, above the plan's largest "
            f"{quantity(design.largest_tension, 'N', 4)}; force limit {quantity(force_limit(inst), 'N', 3)}; friction "
            f"guess {plain(friction.vertex_coefficient)} at vertices, {plain(friction.sheath_coefficient)} in the "
            "sheath",
        ),
        Step(
            "Motors on, tip free, hand off: home to the pretension",
            f"both cells {quantity(inst.pretension, 'N', 4)}; each spool winds {plain(wound, 3)}° "
            f"({plain(stretch, 3)} mm) "
            "from taut; a cell that falls while its motor winds is wired to the other tendon",
        ),
        Step(
            f"The protocol {FIRST_RUN} without a controller (on the twin: tenodesis record {INSTRUMENT} {FIRST_RUN} "
            f"--out {LOG})",
            "the readings of the table below",
        ),
        Step(
            f"Identify the friction: tenodesis identify {LOG} --instrument {INSTRUMENT} fits the 30 s that say the "
            "most; tenodesis plan-identification proposes a protocol that says more",
            "a coefficient between half and twice the guess; otherwise look at the vertices",
        ),
        Step(
            f"The protocol {CONTROLLED} with the controller (--law robust; parameters for a microcontroller: {HEADER})",
            f"no fault; under load the tip comes back to {angle(run.left)} of its angle; no tendon above "
            f"{quantity(run.demand.seen, 'N', 3)}",
        ),
    )


def _meshing(inst: ShortForm, budget: Budget) -> Iterator[Step]:
    """Yield the step that checks the gears' play at both joints."""
    if BACKLASHES[0] not in budget.dimensions:
        return
    seen = []
    for key in BACKLASHES:
        one, radius = budget.dimensions[key], float(getattr(inst, key.replace("backlash", "radius")))
        most = angle(math.degrees(2 * one.tolerance / radius))
        seen.append(f"{NAMES[key].partition(',')[0]} turn by {most} at most ({one.grade.name})")
    yield Step("Without tendons, hold the links of a joint and turn its far half to and fro by hand", "; ".join(seen))
