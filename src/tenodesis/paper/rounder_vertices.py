"""Rounder vertices, the paper's first wish: what radius, coefficient and rope do to loss, hysteresis and both laws."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from tenodesis.control import Controller, LawName, compensated
from tenodesis.control.pairs import pairs
from tenodesis.errors import InstrumentError, NoSolutionError, StudyError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.paper import published, step_load, step_response
from tenodesis.paper.context import WAYS
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Plot, Table, fixed
from tenodesis.report.page import about, json_text, render, write_columns, write_figure, written
from tenodesis.run import COMPONENTS
from tenodesis.scaling import catalogue
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Rows
from tenodesis.simulate.places import Place, Places
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
_SEED = 15
_GEARS = "tendon-gear"
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


@dataclass(frozen=True)
class VertexStudy:
    """The designs of a sweep, each a row with what it costs (:func:`costs`)."""

    inst: Instrument
    axis: str
    """Of the joint that is judged; the vertices of all joints of gears are alike."""
    force: float
    """Load at the tip, N."""
    states: tuple[float, ...]
    """Held output angles, rad."""
    reference_radius: float
    """Radius of the present vertices, at which coefficients are given, m."""
    limits: RadiusLimits
    designs: Rows
    """By surface, rope, coefficient and radius."""
    largest_coefficient: Mapping[tuple[VertexRope, float], float]
    """By rope and radius on metal, the largest coefficient up to the file's at and below which the paper's law is good
    enough in every state; NaN if it is not even without friction."""

    def values(self, name: str) -> list[Any]:
        """Return the values that designs have of a radius, coefficient, rope or surface, each once."""
        return list(dict.fromkeys(row[name] for row in self.designs))

    @property
    def coefficient(self) -> float:
        """The coefficient of the instrument file."""
        return self.inst.friction.vertex_coefficient

    @property
    def plane(self) -> ShortForm:
        """The instrument of the judged joint alone."""
        return _place(self.inst, self.axis)[1]

    @property
    def title(self) -> str:
        """The instrument's name, with the judged joint if there are several."""
        several = len(self.inst.tip_joints) > 1
        return f"{self.inst.name}, {self.axis}" if several else self.inst.name

    def along_radius(self, rope: VertexRope, surface: Surface) -> Rows:
        """Return the designs by radius, at the coefficient of the instrument file."""
        return self.designs.where(rope=rope, surface=surface, coefficient=self.coefficient)

    @property
    def along_coefficient(self) -> Rows:
        """The designs by coefficient on the present vertices, of metal, with tendons that spring back."""
        return self.designs.where(rope=SPRINGY, surface=METAL, radius=self.reference_radius)

    def good_radii(self, rope: VertexRope, surface: Surface) -> list[float]:
        """Return the radii that the joint holds with which the paper's law is good enough in every state, m."""
        rows = self.along_radius(rope, surface)
        return [row["radius"] for row in rows if row["radius"] <= self.held_radius and worst(row, "paper") <= GOOD]

    @property
    def held_radius(self) -> float:
        """The largest radius of the sweep that the joint holds, m, or the smallest if it holds none."""
        return _held(self.values("radius"), self.limits)


def worst(row: Mapping[str, Any], law: LawName) -> float:
    """Return the largest final error of a law over the states, deg; infinite where it faulted in one."""
    return float(np.nan_to_num(np.abs(row[law]), nan=np.inf).max())


def _place(inst: Instrument, axis: str) -> tuple[Place, ShortForm]:
    """Return where a joint is commanded, by axis, and the instrument of it alone; raises InstrumentError if nowhere."""
    known = Places.of(inst).axes
    own = pairs(inst)
    if axis not in own:
        allowed = " or ".join(own) or "a joint with a joint of the handle and a pair of tendons of its own"
        raise InstrumentError(key="axis", value=axis, allowed=allowed)
    return known[axis], dict(zip(own, compensated(inst).planar, strict=True))[axis]


def axes_of(inst: Instrument) -> tuple[str, ...]:
    """Return the axes of the joints of gears that a controller compensates, whose vertices can be studied.

    Raises
    ------
    InstrumentError
        There is none.
    """
    geared = [joint.name for joint in inst.tip_joints if joint.mechanism == _GEARS]
    if not geared:
        kinds = ", ".join(dict.fromkeys(joint.mechanism for joint in inst.tip_joints))
        raise InstrumentError(key="joints.mechanism", value=kinds, allowed=f"{_GEARS}, whose vertices are sharp")
    return tuple(axis for axis, pair in pairs(inst).items() if inst.tip_joints[pair.joint].mechanism == _GEARS)


def radius_limits(inst: Instrument) -> RadiusLimits:
    """Return the largest radii of the arcs that round the vertices of an instrument's joints of gears.

    At a vertex a tendon turns by half of its joint's angle, phi = theta / 2. An arc of radius rho that leaves the
    vertex in its place takes rho tan(phi / 2) of the tendon's way on either side of it. In the free span, 2 r (1 -
    sin phi) between two gears of pitch radius r, two arcs meet: rho <= r (1 - sin phi) / tan(phi / 2). Sideways an arc
    takes rho (1 - cos phi) of the wall between the tendon and the outer diameter of the stem, whose tendons run r to
    the side: rho <= (D / 2 - r - d / 2) / (1 - cos phi), where nothing of the wall is left at its mouth.
    """
    tips, handles = ([one for one in of if one.mechanism == _GEARS] for of in (inst.tip_joints, inst.handle_joints))
    walls = [math.inf]
    if inst.stem_diameter is not None:
        for joint in tips:
            room = inst.stem_diameter / 2 - joint.radius - (inst.tendon_diameter or 0.0) / 2
            walls.append(max(0.0, room) / (1 - math.cos(joint.range / 2)))
    spans = ([_span_limit(joint.radius, joint.range / 2) for joint in of] for of in (tips, handles))
    span, handle_span = (min(of, default=math.inf) for of in spans)
    return RadiusLimits(span, handle_span, min(walls))


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


def ropes(inst: Instrument) -> tuple[VertexRope, ...]:
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


def _diameter(inst: Instrument) -> float:
    if inst.tendon_diameter is None:
        raise InstrumentError(
            f"{inst.name} has no tendon_diameter, which the study of its vertices needs; give it in the file.",
            key="tendon_diameter",
        )
    return inst.tendon_diameter


def redesigned(inst: Instrument, design: VertexDesign, reference_radius: float) -> Instrument:
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


def _assumed(inst: Instrument, changed: Instrument) -> ShortForm:
    """Return the controller's model: stiffness and coefficient at the pretension are identified, bending is not."""
    effective = changed.friction.vertex_coefficient * changed.friction.vertex_factor
    return step_response.controller_model(compensated(inst.replace(**{"friction.vertex_coefficient": effective})))


def _commands(inst: Instrument, place: Place, handle: Array, force: Array | float) -> dict[str, Any]:
    """Return a twin's commands by which a joint is moved (n,), rad, against a force on it, N; the others are straight.

    A force that opposes flexion of a joint is along an axis of the tip where joints act on each other.
    """
    widths = {"handle_angle": len(inst.handle_joints), "force": len(inst.tip_joints), "wrench": len(COMPONENTS)}
    found = {}
    for name, values in (("handle_angle", handle), ("force", np.broadcast_to(force, handle.shape))):
        where = place.where(name)
        found[where.field] = np.zeros((handle.size, widths[where.field]))
        found[where.field][:, where.columns] = where.sign * values[:, np.newaxis]
    return found


def held(  # noqa: PLR0917
    inst: Instrument, changed: Instrument, axis: str, state: float, force: float, law: LawName
) -> float:
    """Return the final error, deg, of a joint's angle (rad) held under a load (N) by a law; NaN if it faults or falls.

    `inst` is the instrument as in its file.
    """
    place, plane = _place(inst, axis)
    motion = step_response.held_motion(plane, state, force, BEFORE, AFTER)
    controller = Controller(_assumed(inst, changed), law=law)
    commands = _commands(inst, place, motion.handle_angle, motion.force)
    try:
        run = Twin(changed, seed=_SEED).run(**commands, controller=controller)
    except NoSolutionError:
        return math.nan
    response = step_response.response(run.axis(axis), motion)
    return math.nan if response.faulted else response.final


def loop(inst: Instrument, axis: str, force: float) -> tuple[float, float]:
    """Return the mean width of the loop of output over handle angle under a load (N), deg, and the delay, deg.

    The handle goes through its working range to either side at rest; the width is between 0.15 and 0.9 of the range in
    flexion, the delay the way of the handle after its reversal in flexion until the tip has moved by 0.1 deg.
    """
    place, _ = _place(inst, axis)
    reach = place.reach
    count = max(2, round(reach / _STEP))
    up = np.linspace(-reach, reach, 2 * count + 1)
    path = np.concatenate([np.linspace(0, reach, count + 1), up[-2::-1], up[1:], up[-2::-1]])
    try:
        run = Twin(inst, quasi_static=True).run(**_commands(inst, place, path, force))
    except NoSolutionError:
        return math.nan, math.nan
    output = run.by_column("output_angle")[:, place.bends[0]]
    down = output[-up.size :]
    rising = output[-2 * up.size + 1 : -up.size + 1]
    grid = WAYS * reach
    width = np.interp(grid, up, down[::-1]) - np.interp(grid, up, rising)
    moved = np.flatnonzero(np.abs(down - down[0]) > _MOVES)
    delay = reach - up[::-1][moved[0]] if moved.size else math.nan
    return float(np.degrees(width.mean())), float(np.degrees(delay))


def costs(  # noqa: PLR0917
    inst: Instrument, axis: str, design: VertexDesign, states: Sequence[float], force: float, reference_radius: float
) -> dict[str, Any]:
    """Return what a design costs in the held states (rad) under a load (N); NaN where the joint does not hold it.

    That is the mean width of the loop of output over handle angle (hysteresis), the way of the handle after its
    reversal in flexion until the tip has moved 0.1 deg (delay), and by law the final errors against eq. 18 by state,
    NaN where the controller faulted; all deg.
    """
    changed = redesigned(inst, design, reference_radius)
    hysteresis, delay = loop(changed, axis, force)
    final: dict[str, Array] = {
        law: np.array([held(inst, changed, axis, state, force, law) for state in states]) for law in LAWS
    }
    return {"hysteresis": hysteresis, "delay": delay, **final}


def held_states(inst: ShortForm) -> tuple[float, ...]:
    """Return the states of Fig. 15 (rad) within an instrument's working range, or its own where that ends earlier."""
    angles = [math.radians(output.value) for _, output in published.STATES]
    if max(angles) > inst.output_range * (1 + 1e-9):
        return tuple(map(float, step_response.held_states(inst)))
    return tuple(angles)


def study(
    inst: Instrument,
    force: float | None = None,
    *,
    axis: str | None = None,
    radii: Iterable[float] | None = None,
    shares: Iterable[float] = SHARES,
    tendons: tuple[VertexRope, ...] | None = None,
    surfaces: tuple[Surface, ...] = (METAL, PLASTIC),
    progress: Callable[[float, float], None] = lambda _done, _total: None,
) -> VertexStudy:
    """Sweep the vertices of an instrument's joints of gears: radius, coefficient, rope and surface.

    Parameters
    ----------
    force
        Load at the tip, N; by default that of the load rig or the second of the instrument's conditions.
    axis
        Of the joint that is judged, the others straight; by default the first of :func:`axes_of`.
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
        No joint has gears and a pair of tendons of its own, or there is none of this axis; the file has no diameter of
        the tendons or no friction at the vertices.
    """
    axis = axes_of(inst)[0] if axis is None else axis
    _, plane = _place(inst, axis)
    limits = radius_limits(inst)
    reference = _diameter(inst) / 2
    present = inst.friction.vertex_coefficient
    if not present:
        raise InstrumentError(
            key="friction.vertex_coefficient", value=0, allowed="above 0: friction at the vertices is what is studied"
        )
    load = step_load.step_force(plane) if force is None else force
    states = held_states(plane)
    if radii is None:
        most = limits.largest
        radii = [*np.geomspace(min(reference, most), most, _RADII), *(factor * most for factor in _BEYOND)]
    found = sorted({float(radius) for radius in radii} | {reference})
    coefficients = sorted({float(share) * present for share in shares} | {present})
    used = ropes(inst) if tendons is None else tendons
    axes = {"surface": surfaces, "rope": used, "coefficient": coefficients, "radius": found}
    designs = [VertexDesign(**case) for case in campaign.cases(**axes)]

    def seen(design: VertexDesign) -> tuple[float, float, float]:
        """Return what the twin sees of a design, so that equal ones are run once."""
        friction = redesigned(inst, design, reference).friction
        bending = friction.tendon_bending_stiffness / (2 * design.radius**2)
        return design.surface.load_index, design.coefficient * friction.vertex_factor, bending

    distinct = {seen(design): design for design in reversed(designs)}
    # Without bending the radius has no effect on metal.
    scans = [
        {"rope": rope, "radius": radius}
        for rope in used
        for radius in dict.fromkeys((reference, _held(found, limits)) if rope.bending_stiffness else (reference,))
    ]
    total = len(distinct) + len(scans)

    def cost(key: tuple[float, float, float]) -> dict[str, Any]:
        return costs(inst, axis, distinct[key], states, load, reference)

    def largest(rope: VertexRope, radius: float) -> dict[str, float]:
        return {"coefficient": _largest_coefficient(inst, axis, states, load, reference, (rope, radius))}

    done = campaign.run(
        cost, campaign.cases(key=distinct), on="threads", progress=lambda count, _: progress(count, total)
    )
    outcomes = {row["key"]: row for row in done}
    scanned = campaign.run(
        largest, scans, on="threads", progress=lambda count, _: progress(len(distinct) + count, total)
    )
    return VertexStudy(
        inst,
        axis,
        load,
        states,
        reference,
        limits,
        Rows(outcomes[seen(design)] | design._asdict() for design in designs),
        {(row["rope"], row["radius"]): row["coefficient"] for row in scanned},
    )


def _held(radii: Sequence[float], limits: RadiusLimits) -> float:
    """Return the largest of the radii that a joint holds, m, or the smallest if it holds none."""
    return max((radius for radius in radii if radius <= limits.largest * (1 + 1e-9)), default=radii[0])


def _largest_coefficient(  # noqa: PLR0917
    inst: Instrument, axis: str, states: Sequence[float], force: float, reference: float, case: tuple[VertexRope, float]
) -> float:
    """Return the largest coefficient below which, in steps, the paper's law is good enough in every state."""
    rope, radius = case
    good = math.nan
    for coefficient in np.linspace(0.0, inst.friction.vertex_coefficient, _SCAN + 1):
        changed = redesigned(inst, VertexDesign(radius, float(coefficient), rope, METAL), reference)
        ends = (held(inst, changed, axis, state, force, "paper") for state in states)
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
    pairs = list(product(found.values("rope"), found.values("surface")))
    good = [(rope, surface, min(some)) for rope, surface in pairs if (some := found.good_radii(rope, surface))]
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
    for rope in found.values("rope"):
        if rope.bending_stiffness:
            before, after = (_coefficient(found.largest_coefficient[rope, one]) for one in (sharp, found.held_radius))
            same = before == after
            stiff.append(f"{rope.name} {before}" + (" on either vertices" if same else f", on {held_mm} {after}"))
    others = f" (with a rope that does not: {'; '.join(stiff)})" if stiff else ""
    return f"{by_radius}; {by_coefficient} with tendons that spring back{others}."


def _coefficient(value: float) -> str:
    return f"at most {value:.2g}" if value > 0 else "none above 0"


RESULTS_SCHEMA = 1
"""Version of the layout of results.json."""

PAGE, NUMBERS, SWEEP = "vertices.html", "results.json", "sweep.csv"
"""What a study is written as, beside its figure."""
_LINES = ("-", "--", ":")


def write(found: VertexStudy, out: Path) -> None:
    """Write vertices.html, results.json, sweep.csv and figures/ into a folder, atomically.

    Raises StudyError if the folder cannot be written.
    """
    shift, states = pretension_shift(found.plane, found.held_radius), _states(found)
    with style.applied(), written(out, StudyError, last=PAGE) as new:
        (new / "figures").mkdir()
        drawn = plot(found)
        values = {
            "tables": tables(found),
            "figure": drawn,
            "drawing": write_figure(drawn, new / "figures"),
            "answer": answer(found),
            "good": GOOD,
            "before": BEFORE,
            "after": AFTER,
        }
        write_columns(_sweep(found), new / SWEEP)
        (new / NUMBERS).write_text(json_text(_results(found, shift)), "utf-8")
        page = render("tenodesis.paper", "rounder_vertices.html.j2", study=found, shift=shift, states=states, **values)
        (new / PAGE).write_text(page, "utf-8")


def _states(found: VertexStudy) -> list[str]:
    return [f"{math.degrees(state):.4g}°" for state in found.states]


def _sweep(found: VertexStudy) -> dict[str, ArrayLike]:
    """Return the sweep by columns: the design's numbers, then what it costs; NaN where a controller faulted."""
    rows = found.designs
    columns: dict[str, ArrayLike] = {
        "radius [m]": rows["radius"],
        "coefficient [1]": rows["coefficient"],
        "bending stiffness [N*m^2]": [row["rope"].bending_stiffness for row in rows],
        "load index [1]": [row["surface"].load_index for row in rows],
        "hysteresis [deg]": rows["hysteresis"],
        "delay [deg]": rows["delay"],
    }
    for law in LAWS:
        for state, column in zip(found.states, rows[law].T, strict=True):
            columns[f"final error {law} at {math.degrees(state):.4g} deg [deg]"] = column
    return columns


def _results(found: VertexStudy, shift: float) -> dict[str, Any]:
    return {
        "schema": RESULTS_SCHEMA,
        "about": about(),
        "instrument": found.inst.name,
        "axis": found.axis,
        "answer": answer(found),
        "force": found.force,
        "states": [math.degrees(state) for state in found.states],
        "reference_radius": found.reference_radius,
        "radius_limits": found.limits._asdict(),
        "largest_radius": found.limits.largest,
        "pretension_shift": shift,
        "ropes": {rope.name: rope.bending_stiffness for rope in found.values("rope")},
        "surfaces": {surface.name: surface.load_index for surface in found.values("surface")},
        "largest_coefficient": [
            {"rope": rope.name, "radius": radius, "coefficient": value}
            for (rope, radius), value in found.largest_coefficient.items()
        ],
        "designs": [
            {
                "radius": row["radius"],
                "coefficient": row["coefficient"],
                "rope": row["rope"].name,
                "surface": row["surface"].name,
                "hysteresis": row["hysteresis"],
                "delay": row["delay"],
                "final_error": {law: row[law] for law in LAWS},
            }
            for row in found.designs
        ],
    }


def tables(found: VertexStudy) -> list[Table]:
    """Return the tables of the page: by radius and rope, and by coefficient."""
    headings = ["lost", "loop", "delay", *(f"paper {state}" for state in _states(found)), "ours"]
    reference = found.reference_radius
    by_radius = [
        [surface.name, rope.name, f"{1e3 * row['radius']:.2g}", *_cells(row)]
        for surface, rope in product(found.values("surface"), found.values("rope"))
        for row in found.along_radius(rope, surface)
        if row["radius"] in {reference, found.held_radius}
    ]
    by_coefficient = [[f"{row['coefficient']:.3g}", *_cells(row)] for row in found.along_coefficient]
    return [
        Table(
            f"Coefficient {found.coefficient:.3g}, present vertices and the largest that the joint holds: angle "
            "lost in the last state with the motors off, loop, delay, final error of the paper’s law by state and the "
            "worst of ours, deg",
            ["surface", "rope", "ρ [mm]", *headings],
            by_radius,
        ),
        Table(
            f"On metal, radius {1e3 * reference:.2g} mm, tendons that spring back: the same by coefficient, deg",
            ["μ", *headings],
            by_coefficient,
        ),
    ]


def _cells(row: Mapping[str, Any]) -> list[str]:
    largest = worst(row, "robust")
    return [
        fixed(-row["off"][-1]),
        fixed(row["hysteresis"]),
        fixed(row["delay"]),
        *(fixed(value) for value in row["paper"]),
        "fault" if math.isinf(largest) else fixed(largest),
    ]


def plot(found: VertexStudy) -> Plot:
    """Return the figure: hysteresis and final errors over radius, final errors over the coefficient."""
    chart = Chart(Figure(figsize=(9.6, 7.4), layout="constrained"))
    (first, second), (third, fourth) = chart.figure.subplots(2, 2)
    radii = chart.keep("radius [mm]", 1e3 * np.array(found.values("radius")))
    surfaces, lines = found.values("surface"), list(zip(found.values("rope"), _LINES, strict=False))
    colors = dict(zip(surfaces, style.LOADS, strict=False))
    last = f"at {math.degrees(found.states[-1]):.4g}°"

    def draw(axis: Axes, name: str, of: Any) -> None:
        for surface, (rope, line) in product(surfaces, lines):
            values = [of(row) for row in found.along_radius(rope, surface)]
            heading = f"{name}, {surface.name}, {rope.name} [deg]"
            chart.curve(axis, radii, heading, values, line, color=colors[surface], marker="o", ms=3.5, lw=1.5)
        axis.axvline(1e3 * found.limits.largest, color=style.INK, lw=1.0)
        axis.set(xscale="log", xlabel="vertex radius [mm]")
        axis.set_xticks(radii, [f"{value:.2g}" for value in radii], minor=False)
        axis.tick_params(axis="x", rotation=45)
        axis.minorticks_off()

    draw(first, "hysteresis", lambda row: row["hysteresis"])
    first.set(ylabel="hysteresis [deg]", title="Loop of output over handle angle")
    first.set_ylim(bottom=0)
    draw(second, "paper", lambda row: abs(row["paper"][-1]))
    second.set(ylabel="final error [deg]", title=f"Paper's law {last}")
    draw(third, "robust", lambda row: worst(row, "robust"))
    third.set(ylabel="final error [deg]", title="Robust law, worst of the states")
    share = chart.keep("coefficient [1]", found.along_coefficient["coefficient"])
    drawn: tuple[tuple[LawName, str, str], ...] = (
        ("paper", "paper's law", style.ANTAGONIST),
        ("robust", "robust law", style.AGONIST),
    )
    for law, name, color in drawn:
        values = [worst(row, law) for row in found.along_coefficient]
        heading = f"{name} over coefficient [deg]"
        chart.curve(fourth, share, heading, values, color=color, marker="o", ms=3.5, label=name)
    fourth.axvline(found.coefficient, color=style.INK, ls=":", lw=1.0)
    fourth.set(xlabel="vertex coefficient [1]", ylabel="final error [deg]", title="Worst of the states, by coefficient")
    fourth.legend(loc="upper left")
    for axis in (second, third, fourth):
        axis.axhline(GOOD, color=style.REFERENCE, ls="--", lw=1.0)
        axis.set_ylim(0, max(axis.get_ylim()[1], 1.2 * GOOD))
    for surface, (rope, line) in product(surfaces, lines):
        first.plot([], [], line, color=colors[surface], label=f"{surface.name}, {rope.name}")
    first.plot([], [], color=style.INK, lw=1.0, label="largest radius that the joint holds")
    handles, names = first.get_legend_handles_labels()
    chart.figure.legend(handles, names, loc="outside upper left", ncols=len(surfaces) + 1)
    return chart.plot(
        "vertices",
        f"{found.title} under {found.force:.3g} N, coefficient {found.coefficient:.3g}. The joint holds "
        f"{1e3 * found.limits.largest:.2g} mm; dotted: the coefficient of the file; "
        f"dashed: {GOOD:g}°.",
    )
