"""The order list and the assembly checklist of a scale model: what to buy and to make, and what to do with it."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple, TypeAlias

from tenodesis import kinematics
from tenodesis.control.parameters import force_limit, tension_limit
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.report.content import fixed
from tenodesis.scaling import Design, Wheel
from tenodesis.scaling.parts import BoughtPart, CataloguePart, Known, Motor
from tenodesis.scaling.plan import angle, masses, plain, quantity
from tenodesis.scaling.practical import is_stock
from tenodesis.workshop.budget import BACKLASHES, NAMES, Budget, tolerance
from tenodesis.workshop.first_run import CONTROLLED, FIRST_RUN, MARGIN, Demand, FirstRun

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


def rope_length(inst: InstrumentLike) -> RopeLength:
    """Return the rope to cut for a tendon of an instrument, m; of two axes, the first."""
    inst = as_short_form(inst).planar[0]
    diameter = inst.tendon_diameter or 0.0
    spool = inst.drives.spool_radius + diameter / 2
    return RopeLength(
        inst.tendon_length or inst.overall_length,
        inst.control.homing_stroke + tension_limit(inst) / inst.tendon_stiffness,
        SPARE_TURNS * 2 * math.pi * spool,
        2 * (_FERRULE * diameter + _TERMINATION),
    )


def order_list(design: Design, demand: Demand) -> tuple[Item, ...]:
    """Return the order list of a design, whose drives must do what a rehearsal of the first run demands."""
    return (
        *_wheels(design),
        *_ropes(design),
        *_sensors(design),
        *_joints(design),
        *_drives(design, demand),
        *_rig(design),
    )


def _wheels(design: Design) -> Iterator[Item]:
    choice, inst = design.choice, design.scaled_up
    axes = len(inst.axes)
    for end, wheel in (("distal", choice.distal), ("proximal", choice.proximal)):
        radius = quantity(wheel.radius, "mm", 6, "m")
        if wheel.module is not None:
            stock = is_stock(design.catalogue, wheel)
            yield Item(
                str(2 * axes), f"{end} gear",
                f"spur gear, module {quantity(wheel.module, 'mm', 4, 'm')}, {wheel.teeth} teeth, 20°",
                f"pitch radius {radius} = radius to the rope's centre; two tunnels to be drilled",
                "bought", "days" if stock else "weeks", "to be checked",
                "ISO 54 (module), ISO 53 (profile); " + ("often kept" if stock else "likely cut to order"),
            )  # fmt: skip
        elif inst.joint_type == "continuum" and end == "distal":
            yield Item(
                f"{axes}", "set of discs", "made to size", f"tendons {radius} from the backbone", "made", "workshop",
                "ours", "drawing",
            )  # fmt: skip
        else:
            groove = quantity(wheel.radius - (inst.tendon_diameter or 0.0) / 2, "mm", 6, "m")
            yield Item(
                str(axes), f"{end} pulley", "turned or printed to size",
                f"radius {radius} to the rope's centre, {groove} to the groove's bottom", "made", "workshop", "ours",
                "drawing",
            )  # fmt: skip
    if choice.rod is not None:
        length = quantity(getattr(inst, "backbone_length", 0.0), "mm", 5, "m")
        take = f"{choice.rod.name}, ⌀ {quantity(choice.rod.diameter, 'mm', 4, 'm')}"
        yield _bought(str(axes), "backbone", choice.rod, f"{length} free, and both clamps")._replace(designation=take)


def _ropes(design: Design) -> Iterator[Item]:
    inst, rope = design.scaled_up.planar[0], design.choice.rope
    count = 2 * len(design.scaled_up.axes)
    cut = rope_length(inst)
    each = math.ceil(cut.total / _ROUNDED - 1e-9) * _ROUNDED
    parts = ", ".join(
        f"{quantity(value, 'mm', 4, 'm')} {name}"
        for name, value in zip(("path", "to wind", "spare turns", "terminations"), cut, strict=True)
    )
    must = (
        f"{fixed(each, 1)} m each ({parts}), {fixed((count + 1) * each, 1)} m in all; breaks at "
        f"{quantity(rope.breaking_load, 'N', 4)} or more"
    )
    yield _bought(
        f"{count} + 1 spare", "rope for tendons", rope, must, lead="days" if rope.diameter >= 1e-3 else "weeks"
    )
    yield Item(
        str(count), "sheaths", "coil sheath with a lining, from handle to motor",
        f"inner ⌀ {quantity(rope.diameter + _PLAY, 'mm', 3, 'm')} or more; as long as the way to the motors, and "
        "that much "
        "rope more", "bought", "weeks", "to be checked", "paper, Fig. 2: flexible tendon-sheath transmission",
    )  # fmt: skip
    for ferrule in _kind(design, "ferrule")[:1]:
        must = f"for a rope of ⌀ {quantity(rope.diameter, 'mm', 3, 'm')}; holds its breaking load, tested on a spare"
        yield _bought(f"{2 * (count + 1)}", "ferrules", ferrule, must)


def _sensors(design: Design) -> Iterator[Item]:
    axes, cell, encoder = len(design.scaled_up.axes), design.choice.load_cell, design.choice.encoder
    must = f"range {quantity(cell.range, 'N', 4)}, resolves {quantity(cell.resolution, 'N', 2)}; with its amplifier"
    yield _bought(str(2 * axes), "load cell", cell, must, lead="weeks")
    if encoder is not None:
        must = f"{encoder.bits} bit; one at the tip, one at the handle, each with its magnet"
        yield _bought(str(2 * axes), "joint encoder", encoder, must)


def _joints(design: Design) -> Iterator[Item]:
    """Yield shafts, bearings and screws; a shaft bends by the pull of both tendons at the controller's limit."""
    inst = design.scaled_up
    force = 2 * tension_limit(inst.planar[0])
    for end, wheel in (("distal", design.choice.distal), ("proximal", design.choice.proximal)):
        if inst.joint_type == "continuum" and end == "distal":
            continue
        count = len(inst.axes) * (1 if wheel.module is None else 2)
        least = _shaft(force, wheel)
        shaft = _least(_kind(design, "shaft"), least)
        bore = least if shaft is None else shaft.size or least
        bearing = next(
            (
                one
                for one in sorted(_kind(design, "bearing"), key=lambda one: one.size or 0.0)
                if (one.size or 0.0) >= bore * (1 - 1e-9) and (one.static_load or 0.0) >= _BEARING_MARGIN * force / 2
            ),
            None,
        )
        if bearing is not None:
            shaft = _least(_kind(design, "shaft"), bearing.size or bore) or shaft
        pull = quantity(force, "N", 3)
        carried = quantity(_BEARING_MARGIN * force / 2, "N", 3)
        seated = f"static load {carried} or more; seated in the links, not in the wheels"
        for part, number, found, what in (
            (f"{end} shafts", count, shaft, f"⌀ {quantity(least, 'mm', 3, 'm')} or more: bent by {pull}"),
            (f"{end} bearings", 2 * count, bearing, seated),
        ):  # fmt: skip
            yield _bought(str(number), part, found, what)
    lengths = kinematics.dimensions(inst)
    yield Item(
        "1", "tube for the stem", f"⌀ {quantity(lengths.stem_diameter, 'mm', 4, 'm')}",
        f"{quantity(lengths.stem_length, 'mm', 5, 'm')} between the joints' ends", "bought", "days", "to be checked",
        "geometry of the instrument file",
    )  # fmt: skip
    for screw, number in zip(_kind(design, "screw"), (24, 8), strict=False):
        yield _bought(str(number * len(inst.axes)), "screws", screw, "number and length as the drawings decide")


def _drives(design: Design, demand: Demand) -> Iterator[Item]:
    inst, spool = design.scaled_up, design.choice.spool
    count = 2 * len(inst.axes)
    groove = quantity(spool.radius - (inst.tendon_diameter or 0.0) / 2, "mm", 5, "m")
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


def _motors(design: Design, demand: Demand) -> list[tuple[str, Motor | None]]:
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


def _rig(design: Design) -> Iterator[Item]:
    if not design.tests:
        return
    needed = Counter[float]()
    for test in design.tests:
        needed |= Counter((*test.weights.loading, *test.weights.counter))
    (piece, *_) = design.catalogue.weights
    count = str(needed.total())
    yield _bought(count, "weights", piece, "enough for each test load in turn")._replace(
        designation=masses(needed.elements())
    )
    radius = design.catalogue.constraints.cable_pulley_radius
    groove = quantity(radius - design.choice.rope.diameter / 2, "mm", 5, "m")
    yield Item(
        "1", "pulley of the load rig", "turned or printed to size",
        f"radius {quantity(radius, 'mm', 5, 'm')} to the cable's centre, {groove} to the groove's bottom", "made",
        "workshop", "ours", "paper, Fig. 13",
    )  # fmt: skip
    yield _bought("2", "cables of the load rig", design.choice.rope, "1 m each, with a hook for the weights")
    for bearing in sorted(_kind(design, "bearing"), key=lambda one: one.size or 0.0)[:1]:
        yield _bought("2", "bearings of the load rig", bearing, "the bar turns about the tip's axis")


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


def _kind(design: Design, kind: str) -> list[BoughtPart]:
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
