"""The order list and the assembly checklist of a scale model: what to buy and to make, and what to do with it."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from tenodesis.control.parameters import force_limit, tension_limit
from tenodesis.instrument import Instrument, expanded
from tenodesis.report.content import fixed
from tenodesis.run import Array
from tenodesis.scaling import AnyDesign, Wheel
from tenodesis.scaling.parts import BoughtPart, CataloguePart, Known, Motor
from tenodesis.scaling.plan import SPACE, angle, masses, plain, quantity, spools_of, weights_needed
from tenodesis.scaling.practical import is_stock
from tenodesis.workshop.budget import BACKLASHES, Budget, named, tolerance
from tenodesis.workshop.first_run import CONTROLLED, FIRST_RUN, MARGIN, Demand, FirstRun, law_of

Provenance: TypeAlias = Known | Literal["ours"]
"""Whether a designation and its values are looked up, quoted by others, assumed, or of our own making."""

SPARE_TURNS = 3
"""Turns of rope that stay on a spool, so that friction and not its end holds it."""
_SHAFT_STRESS = 200e6  # Pa, bending
_SPAN_PER_RADIUS = 2.0  # of a shaft between its bearings, over the wheel's radius
_TERMINATION = 0.03  # m, of rope beyond a ferrule
_FERRULE = 10.0  # diameters
_BEARING_MARGIN = 1.5
_PLAY = 0.3e-3  # m, of a rope in its sheath
_ROUNDED = 0.1  # m, to which ropes are ordered


class Item(NamedTuple):
    """A line of the order list."""

    number: str
    part: str
    designation: str
    requirement: str
    origin: Literal["bought", "made"]
    lead: Literal["days", "weeks", "workshop"]
    status: Provenance
    source: str


class RopeLength(NamedTuple):
    """The rope to cut for one tendon, m, by what takes it."""

    path: float
    """From the spool through handle, joints and stem to the end-effector: the length that stretches in the model."""
    wound: float
    """Wound in by homing and by the controller up to its limit."""
    spare: float
    """Turns that stay on the spool."""
    terminations: float

    @property
    def total(self) -> float:
        """Length to cut."""
        return math.fsum(self)


def rope_lengths(design: AnyDesign) -> tuple[RopeLength, ...]:
    """Return the rope to cut for every tendon of a design, m, in the order of its tendons."""
    inst, rope = design.bench, design.choice.rope
    spool = inst.own_drives.spool_radius + rope.diameter / 2
    return tuple(
        RopeLength(
            rope.rigidity / stiffness,
            inst.control.homing_stroke + tension_limit(inst) / stiffness,
            SPARE_TURNS * 2 * math.pi * spool,
            2 * (_FERRULE * rope.diameter + _TERMINATION),
        )
        for stiffness in design.scaled_up.stiffnesses.tolist()
    )


def order_list(design: AnyDesign, demand: Demand) -> tuple[Item, ...]:
    """Return the order list of a design, whose drives must do what a rehearsal of the first run demands."""
    return (
        *_wheels(design),
        *_ropes(design),
        *_sensors(design),
        *_joints(design),
        *_drives(design, demand),
        *_rig(design),
    )


def _wheels(design: AnyDesign) -> Iterator[Item]:
    rope = design.choice.rope
    for one in design.wheels:
        wheel = one.wheel
        radius = quantity(wheel.radius, "mm", 6, "m")
        if wheel.module is not None:
            stock = is_stock(design.catalogue, wheel)
            yield Item(
                str(one.pieces), one.part,
                f"spur gear, module {quantity(wheel.module, 'mm', 4, 'm')}, {wheel.teeth} teeth, 20°",
                f"pitch radius {radius} = radius to the rope's centre; two tunnels to be drilled",
                "bought", "days" if stock else "weeks", "to be checked",
                "ISO 54 (module), ISO 53 (profile); " + ("often kept" if stock else "likely cut to order"),
            )  # fmt: skip
        elif one.kind == "discs":
            yield Item(
                str(one.pieces), one.part, "made to size", f"tendons {radius} from the backbone",
                "made", "workshop", "ours", "drawing",
            )  # fmt: skip
        else:
            groove = quantity(wheel.radius - rope.diameter / 2, "mm", 6, "m")
            yield Item(
                str(one.pieces), one.part, "turned or printed to size",
                f"radius {radius} to the rope's centre, {groove} to the groove's bottom", "made", "workshop", "ours",
                "drawing",
            )  # fmt: skip
    free = {joint.bend: joint.backbone_length or 0.0 for joint in expanded(design.scaled_up).as_given("joints")}
    for name, rod in design.rods:
        take = f"{rod.name}, ⌀ {quantity(rod.diameter, 'mm', 4, 'm')}"
        must = f"{quantity(free[name], 'mm', 5, 'm')} free, and both clamps"
        yield _bought("1", f"backbone, {name}", rod, must)._replace(designation=take)
    for name, spring in design.choice.springs:
        yield Item(
            "1", f"spring, {name}", "made to its stiffness", f"{quantity(spring, 'N*mm', 4, 'N*m')} per rad", "made",
            "workshop", "ours", "instrument file",
        )  # fmt: skip


def _ropes(design: AnyDesign) -> Iterator[Item]:
    rope, cuts = design.choice.rope, rope_lengths(design)
    lead: Literal["days", "weeks"] = "days" if rope.diameter >= 1e-3 else "weeks"
    for cut, count in Counter(cuts).items():
        each = math.ceil(cut.total / _ROUNDED - 1e-9) * _ROUNDED
        parts = ", ".join(
            f"{quantity(value, 'mm', 4, 'm')} {name}"
            for name, value in zip(("path", "to wind", "spare turns", "terminations"), cut, strict=True)
        )
        must = (
            f"{fixed(each, 1)} m each ({parts}), {fixed((count + 1) * each, 1)} m in all; breaks at "
            f"{quantity(rope.breaking_load, 'N', 4)} or more"
        )
        yield _bought(f"{count} + 1 spare", "rope for tendons", rope, must, lead=lead)
    yield Item(
        str(spools_of(design)), "sheaths", "coil sheath with a lining, from handle to motor",
        f"inner ⌀ {quantity(rope.diameter + _PLAY, 'mm', 3, 'm')} or more; as long as the way to the motors, and "
        "that much "
        "rope more", "bought", "weeks", "to be checked", "paper, Fig. 2: flexible tendon-sheath transmission",
    )  # fmt: skip
    for ferrule in _kind(design, "ferrule")[:1]:
        must = f"for a rope of ⌀ {quantity(rope.diameter, 'mm', 3, 'm')}; holds its breaking load, tested on a spare"
        yield _bought(f"{2 * (len(cuts) + len(set(cuts)))}", "ferrules", ferrule, must)


def _sensors(design: AnyDesign) -> Iterator[Item]:
    cell, encoder, inst = design.choice.load_cell, design.choice.encoder, expanded(design.scaled_up)
    must = f"range {quantity(cell.range, 'N', 4)}, resolves {quantity(cell.resolution, 'N', 2)}; with its amplifier"
    yield _bought(str(spools_of(design)), "load cell", cell, must, lead="weeks")
    if encoder is not None:
        must = f"{encoder.bits} bit; one at every joint of tip and handle, each with its magnet"
        yield _bought(str(len(inst.arc_places) + len(inst.handle_joints)), "joint encoder", encoder, must)


def _joints(design: AnyDesign) -> Iterator[Item]:
    """Yield shafts, bearings and screws; a shaft bends by the pull of two tendons at the controller's limit."""
    inst = expanded(design.scaled_up)
    force = 2 * tension_limit(design.bench)
    for one in design.wheels:
        if one.kind == "discs" or not one.joints:
            continue
        least = _shaft(force, one.wheel)
        shaft = _least(_kind(design, "shaft"), least)
        bore = least if shaft is None else shaft.size or least
        bearing = next(
            (
                found
                for found in sorted(_kind(design, "bearing"), key=lambda found: found.size or 0.0)
                if (found.size or 0.0) >= bore * (1 - 1e-9)
                and (found.static_load or 0.0) >= _BEARING_MARGIN * force / 2
            ),
            None,
        )
        if bearing is not None:
            shaft = _least(_kind(design, "shaft"), bearing.size or bore) or shaft
        pull = quantity(force, "N", 3)
        carried = quantity(_BEARING_MARGIN * force / 2, "N", 3)
        seated = f"static load {carried} or more; seated in the links, not in the wheels"
        for part, number, found, what in (
            (f"shafts, {one.at}", one.pieces, shaft, f"⌀ {quantity(least, 'mm', 3, 'm')} or more: bent by {pull}"),
            (f"bearings, {one.at}", 2 * one.pieces, bearing, seated),
        ):  # fmt: skip
            yield _bought(str(number), part, found, what)
    yield Item(
        "1", "tube for the stem", f"⌀ {quantity(inst.stem_diameter or 0.0, 'mm', 4, 'm')}",
        f"{quantity(inst.stem_length or 0.0, 'mm', 5, 'm')} between the joints' ends", "bought", "days",
        "to be checked", "geometry of the instrument file",
    )  # fmt: skip
    for screw, number in zip(_kind(design, "screw"), (24, 8), strict=False):
        yield _bought(str(number * len(inst.bends)), "screws", screw, "number and length as the drawings decide")


def _drives(design: AnyDesign, demand: Demand) -> Iterator[Item]:
    spool, count = design.choice.spool, spools_of(design)
    groove = quantity(spool.radius - design.choice.rope.diameter / 2, "mm", 5, "m")
    yield Item(
        str(count), "spools", f"radius {quantity(spool.radius, 'mm', 4, 'm')} to the rope's centre",
        f"{groove} to the groove's bottom, {SPARE_TURNS} spare turns", "made", "workshop", "ours", spool.source,
    )  # fmt: skip
    what = (
        f"holds {quantity(demand.torque, 'N*m', 3)} at {quantity(demand.largest_tension, 'N', 3)} on the spool, "
        f"{quantity(MARGIN * demand.speed, 'rad/s', 2)} or more; inertia at the spool up to "
        f"{quantity(demand.inertia, 'kg*m^2', 2)}"
    )
    alternatives = _motors(design, demand)
    if not alternatives:
        yield Item(str(count), "motors", "none of the catalogue", what, "bought", "weeks", "to be checked", "twin")
    for n, (kind, motor) in enumerate(alternatives, 1):
        part = f"motors, alternative {n}"
        if motor is None:
            yield Item(
                str(count), part, f"{kind}: none of the catalogue fits", what, "bought", "weeks",
                "to be checked", "twin",
            )  # fmt: skip
            continue
        own = ", ".join(
            quantity(value, unit, digits)
            for value, unit, digits in (
                (motor.torque, "N*m", 3), (motor.speed, "rad/s", 3), (motor.inertia, "kg*m^2", 2),
            )
        )  # fmt: skip
        yield _bought(str(count), part, motor, f"{what}; has {own}", lead="weeks")
    for n, kind in enumerate(("drive", "acquisition"), 1):
        for found in _kind(design, kind)[:1]:
            many = str(count) if kind == "drive" else "1"
            rating = (
                "one per motor, speed set point" if kind == "drive" else "instead of these drives, as the paper had it"
            )
            yield _bought(many, f"amplifiers, alternative {n}", found, rating, lead="weeks")


def _motors(design: AnyDesign, demand: Demand) -> list[tuple[str, Motor | None]]:
    """Return of every kind of drive the smallest motor that does what is demanded, with the margin of speed."""
    kinds = dict.fromkeys(motor.drive for motor in design.catalogue.motors)
    found: list[tuple[str, Motor | None]] = []
    for kind in kinds:
        able = [
            one
            for one in design.catalogue.motors
            if one.drive == kind
            and one.torque >= demand.torque
            and one.speed >= MARGIN * demand.speed
            and one.inertia <= demand.inertia
        ]
        found.append((kind, min(able, key=lambda one: one.torque, default=None)))
    return found


def _rig(design: AnyDesign) -> Iterator[Item]:
    if not design.tests:
        return
    needed = weights_needed(design)
    (piece, *_) = design.catalogue.weights
    count = str(needed.total())
    yield _bought(count, "weights", piece, "enough for each test load in turn")._replace(
        designation=masses(needed.elements())
    )
    radius = design.bench.conditions.cable_pulley_radius
    if radius is not None:
        groove = quantity(radius - design.choice.rope.diameter / 2, "mm", 5, "m")
        yield Item(
            "1", "pulley of the load rig", "turned or printed to size",
            f"radius {quantity(radius, 'mm', 5, 'm')} to the cable's centre, {groove} to the groove's bottom", "made",
            "workshop", "ours", "paper, Fig. 13",
        )  # fmt: skip
    yield _bought("2", "cables of the load rig", design.choice.rope, "1 m each, with a hook for the weights")
    for bearing in sorted(_kind(design, "bearing"), key=lambda one: one.size or 0.0)[:1]:
        what = "two guide pulleys of any radius" if radius is None else "the bar turns about the tip's axis"
        yield _bought("2", "bearings of the load rig", bearing, what)


def _shaft(force: float, wheel: Wheel) -> float:
    """Return the least diameter (m) of a wheel's shaft between two bearings, by bending."""
    moment = force * _SPAN_PER_RADIUS * wheel.radius / 4
    return float((32 * moment / (math.pi * _SHAFT_STRESS)) ** (1 / 3))


def _bought(
    count: str, part: str, found: CataloguePart | None, what: str, lead: Literal["days", "weeks"] = "days"
) -> Item:
    """Return the line of a part of the catalogue, or of one that it lacks."""
    if found is None:
        return Item(count, part, "none of the catalogue is large enough", what, "bought", lead, "to be checked", "")
    return Item(count, part, getattr(found, "name", ""), what, "bought", lead, found.known, found.source)


def _kind(design: AnyDesign, kind: str) -> list[BoughtPart]:
    return [one for one in design.catalogue.hardware if one.use == kind]


def _least(parts: Sequence[BoughtPart], size: float) -> BoughtPart | None:
    return min(
        (one for one in parts if (one.size or 0.0) >= size * (1 - 1e-9)), key=lambda one: one.size or 0.0, default=None
    )


HEADER, INSTRUMENT, LOG = "controller.h", "scaled-up.toml", "first-run.mcap"
_PROOF = 1.25  # of the controller's limit, as its fault of too much tension
_MASS = 1.0  # kg


class Step(NamedTuple):
    """A step of the assembly: what to do, and what must be seen before the next."""

    do: str
    see: str


def checklist(design: AnyDesign, budget: Budget, run: FirstRun) -> tuple[Step, ...]:
    """Return the steps from the parts on the table to a tip that the controller brings back."""
    inst = design.bench
    limit, stretch = tension_limit(inst), 1e3 * inst.pretensions / inst.stiffnesses
    proof = min(_PROOF * limit, design.choice.rope.breaking_load / 1.2)
    pull, diameter = _PROOF * stretch, design.choice.rope.diameter
    wound = np.degrees(1e-3 * stretch / inst.own_drives.spool_radius)
    friction, pretension = inst.friction, _several(inst.pretensions, 4, "N")
    yielding = "" if law_of(inst) == "joints" else f"; force limit {quantity(force_limit(inst), 'N', 3)}"
    cuts = dict.fromkeys(quantity(one.total, "mm", 5, "m") for one in rope_lengths(design))
    paths = np.array([1e3 * one.path for one in rope_lengths(design)])
    return (
        Step(
            "Measure every part with a tolerance, radii as diameters to the rope's centre (groove's bottom plus the "
            f"rope's {quantity(diameter, 'mm', 3, 'm')})",
            "; ".join(f"{named(key)} {tolerance(one)}" for key, one in budget.dimensions.items() if one.is_drawn),
        ),
        *_meshing(inst, budget),
        Step(
            f"Cut the ropes to {' and '.join(cuts)}, crimp both ends, proof-load each for a minute",
            f"holds {quantity(proof, 'N', 3)}, no strand moves in its ferrule",
        ),
        Step(
            f"Pull test: load each rope to {_several(_PROOF * inst.pretensions, 3, 'N')} three times, read the third "
            "stretch; if it is off by more than its tolerance, give the rope with the modulus found in a "
            "catalogue of your "
            "own, and run tenodesis scale with it again",
            f"stretches {_several(pull, 3, 'mm')} over {_several(paths, 5, 'mm')} "
            f"({_several(inst.stiffnesses / 1e3, 4, 'N/mm')})",
        ),
        Step(
            "Thread from the end-effector: tip anchor, joints, stem, handle, sheath, load cell, "
            f"spool with {SPARE_TURNS} spare turns; tendons are not to cross in the stem",
            "all run free by hand over the whole range, no kink at a vertex",
        ),
        Step(
            f"Hang {quantity(_MASS, 'kg', 3)} on each load cell, then nothing",
            f"reads {quantity(9.80665 * _MASS, 'N', 4)} and 0 N to {quantity(inst.sensors.load_cell_offset, 'N', 2)}; "
            f"range {quantity(inst.sensors.load_cell_range, 'N', 4)}, step "
            f"{quantity(inst.sensors.load_cell_range / 2**inst.sensors.load_cell_bits, 'N', 2)}",
        ),
        Step(
            "Clamp handle and tip straight on a flat, zero all encoders, move each joint by hand",
            f"0° to {angle(math.degrees(inst.sensors.encoder_offset))}; positive in flexion on all",
        ),
        Step(
            f"tenodesis check {INSTRUMENT}",
            f"no warning about tensions; tension limit {quantity(limit, 'N', 4)}, above the plan's largest "
            f"{quantity(design.largest_tension, 'N', 4)}{yielding}; friction guess "
            f"{plain(friction.vertex_coefficient)} at vertices, {plain(friction.sheath_coefficient)} in the sheath",
        ),
        Step(
            "Motors on, tip free, hand off: home to the pretension",
            f"cells {pretension}; each spool winds {_several(wound, 3, '°')} ({_several(stretch, 3, 'mm')}) from taut; "
            "a cell that falls while its motor winds is wired to another tendon",
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
            f"The protocol {CONTROLLED} with the controller (--law {law_of(inst)}; parameters for a microcontroller: "
            f"{HEADER})",
            f"no fault; under load the tip comes back to {angle(run.left)} of its angle; no tendon above "
            f"{quantity(run.demand.seen, 'N', 3)}",
        ),
    )


def _several(values: Array, digits: int, unit: str) -> str:
    """Return what tendons have, with its unit: one value where they are alike, otherwise each once."""
    shown = dict.fromkeys(plain(float(one), digits) for one in values)
    return f"{', '.join(shown)}{'' if unit == '°' else SPACE}{unit}"


def _meshing(inst: Instrument, budget: Budget) -> Iterator[Step]:
    """Yield the step that checks the gears' play at both joints."""
    if BACKLASHES[0] not in budget.dimensions:
        return
    seen = []
    for key in BACKLASHES:
        one, radius = budget.dimensions[key], float(getattr(inst, key.replace("backlash", "radius")))
        most = angle(math.degrees(2 * one.tolerance / radius))
        seen.append(f"{named(key).partition(',')[0]} turn by {most} at most ({one.grade.name})")
    yield Step("Without tendons, hold the links of a joint and turn its far half to and fro by hand", "; ".join(seen))
