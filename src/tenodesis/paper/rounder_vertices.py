"""Rounder vertices, the paper's first wish: what radius, coefficient and rope do to loss, hysteresis and both laws."""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tenodesis import statics
from tenodesis.control import LawName
from tenodesis.errors import InstrumentError, NoSolutionError, StudyError
from tenodesis.instrument import ShortForm, TendonGear
from tenodesis.paper import published, step_load, step_response
from tenodesis.paper.context import WAYS
from tenodesis.report.content import Array
from tenodesis.scaling import catalogue
from tenodesis.simulate import campaign
from tenodesis.twin import Twin

LAWS: tuple[LawName, ...] = ("off", "paper", "robust")
"""Laws that hold the states: motors off, eq. 22 as a set point, ours."""
GOOD = 1.0
"""Final error with which a law is good enough, deg."""
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0, 1.5)
"""Coefficients of the sweep, over that of the instrument file."""

BEFORE, AFTER = 4.0, 8.0
"""Time before the load and under it, s."""
_BEYOND = (2.0, 4.0)  # times the largest radius that the joint holds
_RADII = 5  # up to that
_SCAN = 20  # steps up to the coefficient of the file
_STEP = math.radians(0.1)
_MOVES = math.radians(0.1)
_WIRES_ACROSS_STRAND = {7: 3, 19: 5}


class Surface(NamedTuple):
    """What the tendons slide on, and the power of the tension that friction grows with there."""

    name: str
    load_index: float


METAL, PLASTIC = Surface("metal", 1.0), Surface("plastic", 0.82)
"""As measured on published recordings, docs/friction-models.md: cables over pulleys, and in a sheath."""


class VertexRope(NamedTuple):
    """A tendon's rope, and its bending stiffness that does not spring back, N·m²."""

    name: str
    bending_stiffness: float


SPRINGY = VertexRope("springs back", 0.0)
"""A tendon that loses nothing in bending."""


class RadiusLimits(NamedTuple):
    """The largest radii of the vertices' arcs by what limits them, m; infinite without a limit."""

    span: float
    """The arcs of two gears meet in the free span."""
    handle_span: float
    """The same in the handle's joint."""
    wall: float
    """The arc cuts through the wall between the tendon and the stem's outer diameter."""

    @property
    def largest(self) -> float:
        """The smallest of them, m."""
        return min(self)

    @property
    def reason(self) -> str:
        """What limits the radius, in words."""
        reasons = ("the free span between the distal gears", "the free span at the handle", "the wall of the joint")
        return reasons[self.index(self.largest)]


class VertexDesign(NamedTuple):
    """A design of the vertices: radius (m), coefficient at the reference radius, rope and surface."""

    radius: float
    coefficient: float
    rope: VertexRope
    surface: Surface


class VertexOutcome(NamedTuple):
    """What a design costs: NaN where the joint does not hold the load."""

    hysteresis: float
    """Mean width of the loop of output over handle angle under the load, deg."""
    delay: float
    """Way of the handle after its reversal in flexion until the tip has moved 0.1 deg, deg."""
    final: dict[LawName, Array]
    """Final errors against eq. 18 by law and state, deg; NaN where the controller faulted."""

    def worst(self, law: LawName) -> float:
        """Return the largest final error of a law over the states, deg; infinite where it faulted in one."""
        return float(np.nan_to_num(np.abs(self.final[law]), nan=np.inf).max())

    @property
    def lost(self) -> Array:
        """Output angle lost with the motors off, by state, deg."""
        return -self.final["off"]


@dataclass(frozen=True)
class VertexStudy:
    """The designs of a sweep with their outcomes."""

    inst: ShortForm
    force: float
    """Load at the tip, N."""
    states: tuple[float, ...]
    """Held output angles, rad."""
    reference_radius: float
    """Radius of the present vertices, at which coefficients are given, m."""
    limits: RadiusLimits
    radii: tuple[float, ...]
    coefficients: tuple[float, ...]
    ropes: tuple[VertexRope, ...]
    surfaces: tuple[Surface, ...]
    outcomes: dict[VertexDesign, VertexOutcome]
    largest_coefficient: dict[tuple[VertexRope, float], float]
    """By rope and radius on metal, the largest coefficient up to the file's at and below which the paper's law is good
    enough in every state; NaN if it is not even without friction."""

    @property
    def coefficient(self) -> float:
        """The coefficient of the instrument file."""
        return self.inst.friction.vertex_coefficient

    def along_radius(self, rope: VertexRope, surface: Surface, coefficient: float | None = None) -> list[VertexOutcome]:
        """Return the outcomes by radius, at the coefficient of the instrument file or another."""
        found = self.coefficient if coefficient is None else coefficient
        return [self.outcomes[VertexDesign(radius, found, rope, surface)] for radius in self.radii]

    def along_coefficient(self, rope: VertexRope = SPRINGY, surface: Surface = METAL) -> list[VertexOutcome]:
        """Return the outcomes by coefficient on the present vertices."""
        return [self.outcomes[VertexDesign(self.reference_radius, one, rope, surface)] for one in self.coefficients]

    def good_radii(self, rope: VertexRope, surface: Surface) -> list[float]:
        """Return the radii that the joint holds with which the paper's law is good enough in every state, m."""
        pairs = zip(self.radii, self.along_radius(rope, surface), strict=True)
        return [radius for radius, one in pairs if radius <= self.held_radius and one.worst("paper") <= GOOD]

    @property
    def held_radius(self) -> float:
        """The largest radius of the sweep that the joint holds, m, or the smallest if it holds none."""
        return _held(self.radii, self.limits)


def radius_limits(inst: ShortForm) -> RadiusLimits:
    """Return the largest radii of the arcs that round the vertices of an instrument's joints.

    At a vertex a tendon turns by half of its joint's angle, phi = theta / 2. An arc of radius rho that leaves the
    vertex in its place takes rho tan(phi / 2) of the tendon's way on either side of it. In the free span, 2 r (1 -
    sin phi) between two gears of pitch radius r, two arcs meet: rho <= r (1 - sin phi) / tan(phi / 2). Sideways an arc
    takes rho (1 - cos phi) of the wall between the tendon and the outer diameter of the stem, whose tendons run r to
    the side: rho <= (D / 2 - r - d / 2) / (1 - cos phi), where nothing of the wall is left at its mouth.

    Raises
    ------
    InstrumentError
        The joint has no gears, whose vertices could be rounded.
    """
    if not isinstance(inst, TendonGear):
        raise InstrumentError(key="joint_type", value=inst.joint_type, allowed="tendon-gear, whose vertices are sharp")
    distal, proximal = inst.distal_gear_radius, inst.proximal_gear_radius
    phi = inst.output_range / 2
    wall = math.inf
    if inst.stem_diameter is not None:
        room = inst.stem_diameter / 2 - distal - (inst.tendon_diameter or 0.0) / 2
        wall = max(0.0, room) / (1 - math.cos(phi))
    return RadiusLimits(_span_limit(distal, phi), _span_limit(proximal, inst.handle_range / 2), wall)


def _span_limit(radius: float, phi: float) -> float:
    return radius * (1 - math.sin(phi)) / math.tan(phi / 2)


def bending_stiffness(name: str, diameter: float, modulus: float) -> float:
    """Return the bending stiffness of a wire rope whose wires slide freely, N·m².

    Each of its wires, of diameter delta, bends alone: N E_w pi delta^4 / 64 = E A delta^2 / 16, with the stiffness E A
    of the whole rope. A rope of m strands 1 + 6 is three strands across, a strand of 7 wires three, of 19 five.

    Raises
    ------
    StudyError
        The name has no construction of known wires, such as 7x7 or 7x19.
    """
    found = re.match(r"7x(\d+)\b", name)
    across = _WIRES_ACROSS_STRAND.get(int(found[1])) if found else None
    if across is None:
        raise StudyError(key="rope", value=name, allowed="a rope of construction 7x7 or 7x19")
    wire = diameter / (3 * across)
    return modulus * math.pi * diameter**2 / 4 * wire**2 / 16


def ropes(inst: ShortForm) -> tuple[VertexRope, ...]:
    """Return a tendon that springs back, and of each construction in the catalogue the rope nearest in diameter.

    Raises
    ------
    InstrumentError
        The instrument's file does not give the tendons' diameter.
    """
    diameter = _diameter(inst)
    by_construction: dict[str, tuple[float, VertexRope]] = {}
    for rope in catalogue.load().ropes:
        construction = rope.name.partition(" ")[0]
        off = abs(rope.diameter - diameter)
        if construction not in by_construction or off < by_construction[construction][0]:
            stiffness = bending_stiffness(rope.name, rope.diameter, rope.modulus)
            by_construction[construction] = off, VertexRope(f"{construction} {1e3 * rope.diameter:g} mm", stiffness)
    return SPRINGY, *(rope for _, rope in by_construction.values())


def _diameter(inst: ShortForm) -> float:
    if inst.tendon_diameter is None:
        raise InstrumentError(
            f"{inst.name} has no tendon_diameter, which the study of its vertices needs; give it in the file.",
            key="tendon_diameter",
        )
    return inst.tendon_diameter


def redesigned(inst: ShortForm, design: VertexDesign, reference_radius: float) -> ShortForm:
    """Return an instrument with other vertices; coefficients are at its pretension and the reference radius (m).

    The tendons keep their stiffness: of a rope only the bending counts.
    """
    friction = {
        "law": "capstan-power",
        "static_ratio": 1.0,
        "vertex_coefficient": design.coefficient,
        "load_index": design.surface.load_index,
        "reference_tension": inst.pretension,
        "reference_radius": reference_radius,
        "vertex_radius": design.radius,
        "tendon_bending_stiffness": design.rope.bending_stiffness,
    }
    return inst.replace(**{f"friction.{key}": value for key, value in friction.items()})


def _assumed(inst: ShortForm, changed: ShortForm) -> ShortForm:
    """Return the controller's model: stiffness and coefficient at the pretension are identified, bending is not."""
    effective = changed.friction.vertex_coefficient * changed.friction.vertex_factor
    return step_response.controller_model(inst.replace(**{"friction.vertex_coefficient": effective}))


def held(inst: ShortForm, changed: ShortForm, state: float, force: float, law: LawName) -> float:
    """Return the final error, deg, of an output angle (rad) held under a load (N) by a law; NaN if it faults or falls.

    `inst` is the instrument as in its file.
    """
    motion = step_response.held_motion(inst, state, force, BEFORE, AFTER)
    try:
        run = step_response.simulate_motion(changed, _assumed(inst, changed), motion, law)
    except NoSolutionError:
        return math.nan
    response = step_response.response(run, motion)
    return math.nan if response.faulted else response.final


def loop(inst: ShortForm, force: float) -> tuple[float, float]:
    """Return the mean width of the loop of output over handle angle under a load (N), deg, and the delay, deg.

    The handle goes through its working range to either side at rest; the width is between 0.15 and 0.9 of the range in
    flexion, the delay the way of the handle after its reversal in flexion until the tip has moved by 0.1 deg.
    """
    reach = statics.reach(inst)
    count = max(2, round(reach / _STEP))
    up = np.linspace(-reach, reach, 2 * count + 1)
    path = np.concatenate([np.linspace(0, reach, count + 1), up[-2::-1], up[1:], up[-2::-1]])
    try:
        output = Twin(inst, quasi_static=True).run(path, force)["output_angle"]
    except NoSolutionError:
        return math.nan, math.nan
    down = output[-up.size :]
    rising = output[-2 * up.size + 1 : -up.size + 1]
    grid = WAYS * reach
    width = np.interp(grid, up, down[::-1]) - np.interp(grid, up, rising)
    moved = np.flatnonzero(np.abs(down - down[0]) > _MOVES)
    delay = reach - up[::-1][moved[0]] if moved.size else math.nan
    return float(np.degrees(width.mean())), float(np.degrees(delay))


def outcome(
    inst: ShortForm, design: VertexDesign, states: Sequence[float], force: float, reference_radius: float
) -> VertexOutcome:
    """Compute what a design costs in the held states (rad) under a load (N)."""
    changed = redesigned(inst, design, reference_radius)
    by_law = {law: np.array([held(inst, changed, state, force, law) for state in states]) for law in LAWS}
    return VertexOutcome(*loop(changed, force), by_law)


def held_states(inst: ShortForm) -> tuple[float, ...]:
    """Return the states of Fig. 15 (rad) within an instrument's working range, or its own where that ends earlier."""
    angles = [math.radians(output.value) for _, output in published.STATES]
    if max(angles) > inst.output_range * (1 + 1e-9):
        return tuple(map(float, step_response.held_states(inst)))
    return tuple(angles)


def study(
    inst: ShortForm,
    force: float | None = None,
    *,
    radii: Iterable[float] | None = None,
    shares: Iterable[float] = SHARES,
    tendons: tuple[VertexRope, ...] | None = None,
    surfaces: tuple[Surface, ...] = (METAL, PLASTIC),
    progress: Callable[[float, float], None] = lambda _done, _total: None,
) -> VertexStudy:
    """Sweep the vertices of a planar instrument: radius, coefficient, rope and surface.

    Parameters
    ----------
    force
        Load at the tip, N; by default that of the load rig or the second of the instrument's conditions.
    radii
        Radii of the vertices, m; by default from the tendon's own to four times the largest that the joint holds. The
        present radius, half of the tendon's diameter, is always among them.
    shares
        Coefficients over that of the file, which is always among them.
    tendons
        Ropes, a tendon that springs back first; by default those of :func:`ropes`.
    progress
        Called with how much is done, and of how much.

    Raises
    ------
    InstrumentError
        The joint has no gears, its file no diameter of the tendons or no friction at the vertices.
    """
    limits = radius_limits(inst)
    reference = _diameter(inst) / 2
    if not inst.friction.vertex_coefficient:
        raise InstrumentError(
            key="friction.vertex_coefficient", value=0, allowed="above 0: friction at the vertices is what is studied"
        )
    load = step_load.step_force(inst) if force is None else force
    states = held_states(inst)
    if radii is None:
        most = limits.largest
        radii = [*np.geomspace(min(reference, most), most, _RADII), *(factor * most for factor in _BEYOND)]
    found = tuple(sorted({float(radius) for radius in radii} | {reference}))
    present = inst.friction.vertex_coefficient
    coefficients = tuple(sorted({float(share) * present for share in shares} | {present}))
    used = ropes(inst) if tendons is None else tendons
    designs = [
        VertexDesign(radius, coefficient, rope, surface)
        for surface in surfaces
        for rope in used
        for coefficient in coefficients
        for radius in found
    ]

    def seen(design: VertexDesign) -> tuple[float, float, float]:
        """Return what the twin sees of a design, so that equal ones are run once."""
        friction = redesigned(inst, design, reference).friction
        bending = friction.tendon_bending_stiffness / (2 * design.radius**2)
        return design.surface.load_index, design.coefficient * friction.vertex_factor, bending

    distinct = {seen(design): design for design in reversed(designs)}
    # Without bending the radius has no effect on metal.
    scanned = [
        (rope, radius)
        for rope in used
        for radius in dict.fromkeys((reference, _held(found, limits)) if rope.bending_stiffness else (reference,))
    ]
    total = len(distinct) + len(scanned)

    def design_of(key: tuple[float, float, float]) -> dict[str, VertexOutcome]:
        return {"outcome": outcome(inst, distinct[key], states, load, reference)}

    def largest_of(rope: VertexRope, radius: float) -> dict[str, float]:
        return {"coefficient": _largest_coefficient(inst, states, load, reference, (rope, radius))}

    done = campaign.run(
        design_of,
        campaign.cases(key=distinct),
        on="threads",
        progress=lambda count, _: progress(count, total),
    )
    outcomes = {row["key"]: row["outcome"] for row in done}
    scans = [{"rope": rope, "radius": radius} for rope, radius in scanned]
    largest = campaign.run(
        largest_of, scans, on="threads", progress=lambda count, _: progress(len(distinct) + count, total)
    )
    return VertexStudy(
        inst,
        load,
        states,
        reference,
        limits,
        found,
        coefficients,
        used,
        surfaces,
        {design: outcomes[seen(design)] for design in designs},
        {(row["rope"], row["radius"]): row["coefficient"] for row in largest},
    )


def _held(radii: Sequence[float], limits: RadiusLimits) -> float:
    """Return the largest of the radii that a joint holds, m, or the smallest if it holds none."""
    return max((radius for radius in radii if radius <= limits.largest * (1 + 1e-9)), default=radii[0])


def _largest_coefficient(
    inst: ShortForm, states: Sequence[float], force: float, reference: float, case: tuple[VertexRope, float]
) -> float:
    """Return the largest coefficient below which, in steps, the paper's law is good enough in every state."""
    rope, radius = case
    good = math.nan
    for coefficient in np.linspace(0.0, inst.friction.vertex_coefficient, _SCAN + 1):
        changed = redesigned(inst, VertexDesign(radius, float(coefficient), rope, METAL), reference)
        ends = (held(inst, changed, state, force, "paper") for state in states)
        if any(not abs(end) <= GOOD for end in ends):
            break
        good = float(coefficient)
    return good


def pretension_shift(inst: ShortForm, radius: float) -> float:
    """Return by how much arcs of a radius (m) change the pretension over the working range, N, at most.

    A tendon on an arc has the moment arm of the span's line, r cos phi -/+ rho (1 - cos phi) +/- b sin phi inside and
    outside the bend, where the arc begins b before the vertex. Integrated over both gears its excursion is 2 r sin phi
    -/+ 2 (rho (phi - sin phi) - b (1 - cos phi)); b = rho tan(phi / 2) at the end of the range leaves the vertex in
    its place there. The second term is what the way of both tendons grows by.
    """
    phi = np.linspace(0.0, inst.output_range / 2, 201)
    begin = radius * math.tan(phi[-1] / 2)
    difference = 2 * (radius * (phi - np.sin(phi)) - begin * (1 - np.cos(phi)))
    return float(inst.tendon_stiffness * np.abs(difference).max())


def answer(found: VertexStudy) -> str:
    """Return in a sentence which redesign makes the paper's law good enough, within what the joint holds."""
    sharp, held_mm = found.reference_radius, f"{1e3 * found.held_radius:.2g} mm"
    radii = {(rope, surface): found.good_radii(rope, surface) for rope in found.ropes for surface in found.surfaces}
    good = [(rope, surface, min(some)) for (rope, surface), some in radii.items() if some]
    goal = f"brings the paper's law within {GOOD:g}° in every state"
    if good:
        named = "; ".join(f"{1e3 * radius:.2g} mm ({rope.name}, {surface.name})" for rope, surface, radius in good)
        by_radius = f"At the present coefficient a radius {goal}: {named}"
    else:
        by_radius = f"No radius up to the {held_mm} that the joint holds {goal}"
    present = found.largest_coefficient[SPRINGY, sharp]
    if math.isnan(present):
        return f"{by_radius}, and no coefficient: friction at the vertices is not what the paper's law lacks."
    if present >= found.coefficient:
        return f"{by_radius}, and with tendons that spring back the paper's law is as good already."
    by_coefficient = f"a coefficient of at most {present:.2g} instead of {found.coefficient:.2g} does"
    stiff = []
    for rope in found.ropes:
        if rope.bending_stiffness:
            before, after = (_coefficient(found.largest_coefficient[rope, one]) for one in (sharp, found.held_radius))
            same = before == after
            stiff.append(f"{rope.name} {before}" + (" on either vertices" if same else f", on {held_mm} {after}"))
    others = f" (with a rope that does not: {'; '.join(stiff)})" if stiff else ""
    return f"{by_radius}; {by_coefficient} with tendons that spring back{others}."


def _coefficient(value: float) -> str:
    return f"at most {value:.2g}" if value > 0 else "none above 0"
