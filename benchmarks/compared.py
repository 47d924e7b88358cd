"""Tenodesis beside public simulators on the same work: a rope over a pulley, and a backbone.

A peer runs in a process of its own, by the Python that has it (``--python``), so that none is a dependency; one that is
not installed there is skipped, and its figures of an earlier run stay. With ``--figures docs/results.json`` the tables
of docs/peers.md are written anew.
"""

import argparse
import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from timeit import repeat
from typing import Any

import mujoco
import numpy as np
from backbones import BACKBONE
from backbones import backbone as backbone_of
from peers import chain_dynamics, scipy_peer
from peers.chain_peer import ChainPeer
from scipy.integrate import solve_bvp
from scipy.special import lambertw

import tenodesis as tn
from tenodesis import statics, tendon
from tenodesis.identification.any_instrument import AtRest, at_rest
from tenodesis.instrument import FullForm
from tenodesis.statics import chain

sys.path.append(str(Path(__file__).parents[1] / "studies"))

import figures

PEERS = Path(__file__).parent / "peers"
GRAVITY, MASSES, COEFFICIENTS = 9.81, (1.0, 3.0), (0.0, 0.2)
MOMENT, FORCE = 0.02, 0.5
"""Of a tendon at the backbone's end, N m, and a force across in the stem's axes, N."""
MANY, ROUNDS = 4096, 5
"""Worlds together; runs of which the fastest counts."""
ARCS = 4
FEW, MORE = 10, 1010
"""Steps of worlds together, by whose difference their rate is taken without the time to build them."""
RATES = (
    figures.Heading("steps", "steps a second, one world", "1/s", ".3g"),
    figures.Heading("many", f"of {MANY} worlds together", "1/s", ".3g"),
    figures.Heading("version", "version"),
)
ROPE, FINGER = (
    (
        figures.Heading("error_frictionless", "error without friction", unit, ".3g"),
        figures.Heading("error_friction", "error with μ = 0.2", unit, ".3g"),
        *RATES,
    )
    for unit in ("%", "°")
)
PLANAR = (figures.Heading("error", "error of the output angle", "°", ".2g"), *RATES)
TIP = (
    figures.Heading("place", "error of the end's place", "% of length", ".3g"),
    figures.Heading("angle", "of its angle", "°", ".3g"),
    figures.Heading("solves", "equilibria a second", "1/s", ".3g"),
    *RATES,
)
PLACE = figures.Heading("place", "difference of place", "% of length", ".3g")
ELASTICA = figures.Heading("version", "version of PyElastica")
SPACE = (
    PLACE,
    figures.Heading("angle", "of the end's axis", "°", ".3g"),
    figures.Heading("bend", "bend of the end", "°", ".3g"),
    ELASTICA,
)
SEGMENTS = (
    figures.Heading("x", "x of the end", "mm", ".4g"),
    figures.Heading("z", "z", "mm", ".4g"),
    PLACE,
    figures.Heading("angle", "of angle", "°", ".3g"),
    ELASTICA,
)
Row = list[Any]


def of_peer(python: str, program: str, *options: object) -> dict[str, Any] | None:
    """Return what a peer's program prints, or None, with a sentence, where it is not installed."""
    done = subprocess.run(
        [python, "-P", str(PEERS / program), *map(str, options)], capture_output=True, text=True, check=False
    )
    if "ModuleNotFoundError" in done.stderr:
        print(f"{program} is skipped, and its recorded figures stay: {done.stderr.strip().splitlines()[-1]}.")
        return None
    if done.returncode:
        raise SystemExit(f"{program} failed: {done.stderr[-800:]}")
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def exact_ratio(coefficient: float) -> float:
    """Return the ratio of both tensions of a rope that slides over half of a pulley."""
    return math.exp(coefficient * math.pi)


def ratio_of(acceleration: float) -> float:
    """Return the ratio of both tensions by the acceleration of the masses, m/s^2."""
    light, heavy = MASSES
    return heavy * (GRAVITY - acceleration) / (light * (GRAVITY + acceleration))


def off(ratios: dict[float, float]) -> Row:
    """Return the errors of ratios of tensions, %."""
    return [100 * abs(ratios[one] / exact_ratio(one) - 1) for one in COEFFICIENTS]


def rope(python: str) -> dict[str, Row]:
    """Return the rows of the rope."""
    pulled = np.linspace(0.0, 30.0, 100_001)
    ratios = {one: 30.0 / float(tendon.transmit(pulled, one * math.pi)[-1]) for one in COEFFICIENTS}
    took = min(repeat(partial(tendon.transmit, pulled, 0.2 * math.pi), number=1, repeat=ROUNDS))
    rows: dict[str, Row] = {"Tenodesis, contact alone": [*off(ratios), len(pulled) / took, None, tn.__version__]}
    found = of_peer(python, "newton_rope.py", "--worlds", MANY, "--masses", *MASSES)
    for name in ("XPBD", "VBD") if found is not None else ():
        assert found is not None
        own = found[name]
        by = {float(key): ratio_of(value) for key, value in own["acceleration"].items()}
        rows[f"Newton {name}"] = [*off(by), own["steps"], own["steps of worlds"], found["version"]]
    mujoco, by, rate = mujoco_rope()
    rows["MuJoCo, which has no friction on tendons"] = [*off(by), rate, None, mujoco]
    return rows


def mujoco_rope() -> tuple[str, dict[float, float], float]:
    """Return MuJoCo's version, ratios of tensions by coefficient, all without friction, and steps a second."""
    light, heavy = (
        f'<body name="{name}" pos="{x} 0 -1.5"><joint type="slide" axis="0 0 1"/><geom size=".05" mass="{mass}"/>'
        f'<site name="{name}"/></body>'
        for name, x, mass in (("light", -0.15, MASSES[0]), ("heavy", 0.15, MASSES[1]))
    )
    # The rope is a spring, as stiff as Newton's; its length at rest is that at the start.
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{1 / 1920}" gravity="0 0 -{GRAVITY}"><flag contact="disable"/></option><worldbody>
        <geom name="pulley" type="cylinder" size=".15 .04" euler="90 0 0" contype="0" conaffinity="0"/>
        <site name="top" pos="0 0 .2"/>{light}{heavy}</worldbody><tendon><spatial stiffness="1e5" damping="200">
        <site site="light"/><geom geom="pulley" sidesite="top"/><site site="heavy"/></spatial></tendon></mujoco>"""
    )
    data = mujoco.MjData(model)
    count = 960
    ways = np.empty(count)
    for at in range(count):
        mujoco.mj_step(model, data)
        ways[at] = data.qpos[0]
    times = model.opt.timestep * np.arange(1, count + 1)
    late = times > 0.1
    acceleration = 2 * float(np.polyfit(times[late], ways[late], 2)[0])
    begun = time.perf_counter()
    mujoco.mj_resetData(model, data)
    mujoco.mj_step(model, data, count)
    rate = count / (time.perf_counter() - begun)
    return mujoco.__version__, dict.fromkeys(COEFFICIENTS, ratio_of(acceleration)), rate


def of_worlds(inst: FullForm, time_step: float, **acting: Row) -> float:
    """Return the steps a second of worlds together, under what acts all the time."""
    took = []
    for count in (FEW, MORE):
        given: dict[str, Any] = {name: np.tile(values, (count, 1)) for name, values in acting.items()}
        begun = time.perf_counter()
        tn.twin.run_many([inst] * MANY, np.zeros((count, 0)), time_step=time_step, every=count, **given)
        took.append(time.perf_counter() - begun)
    return MANY * (MORE - FEW) / (took[1] - took[0])


def finger(_: str) -> dict[str, Row]:
    """Return the rows of a finger of three sprung pulleys, one tendon over all, pulled by a tension."""
    radius, spring, most = 5e-3, 0.05, 8.0
    names = ("first", "second", "third")
    pulleys: list[dict[str, Any]] = [
        {"name": name, "mechanism": "pulley", "axis": "yaw", "radius": radius, "stiffness": spring, "offset": 30e-3}
        for name in names
    ]
    pulleys[-1]["end_effector_length"] = 20e-3
    route = [{"joint": name, "side": "agonist"} for name in names]
    pulled = np.concatenate([np.linspace(0.0, most, 400), np.full(100, most)])[:, np.newaxis]

    def made(coefficient: float) -> Any:
        friction = {"law": "capstan", "vertex_coefficient": coefficient, "sheath_coefficient": 0.0, "sheath_bend": 0.0}
        like = tn.instrument.expanded("two-segment-continuum")
        tendons = [{"name": "flexor", "route": route, "stiffness": 3e4, "pretension": 0.0}]
        return like.replace(joints=pulleys, tendons=tendons, friction=friction, sources=None)

    def exact(coefficient: float) -> Any:
        """Return the angles where each spring balances the tension beyond its pulley, which its own wrap takes from."""
        tension, angles = most, []
        for _ in names:
            free = radius * tension / spring
            angles.append(float(lambertw(coefficient * free).real) / coefficient if coefficient else free)
            tension = spring * angles[-1] / radius
        return np.array(angles)

    own = []
    for one in COEFFICIENTS:
        slow = tn.twin.Twin(made(one), time_step=1e-4, quasi_static=True)
        angles = np.asarray(slow.run(np.zeros((len(pulled), 0)), spool_tension=pulled).output_angle)[-1]
        own.append(float(np.degrees(np.abs(angles - exact(one)).max())))
    twin = tn.twin.Twin(made(0.2), time_step=1e-4)
    begun = np.zeros((len(pulled), 0))
    steps = len(pulled) / min(repeat(partial(twin.run, begun, spool_tension=pulled), number=1, repeat=ROUNDS))
    many = of_worlds(made(0.2), 1e-4, spool_velocity=[5.0])
    rows: dict[str, Row] = {"Tenodesis": [*own, steps, many, tn.__version__]}
    smooth = made(0.0)
    strokes = statics.strokes_at_tensions(smooth, [most])
    angles = ChainPeer(smooth).settle([], strokes=strokes).angles
    off_by = [float(np.degrees(np.abs(angles - exact(one)).max())) for one in COEFFICIENTS]
    rate = chain_dynamics.steps_per_second(smooth, [0.0] * 6, time_step=1e-4, seconds=0.5)
    rows["MuJoCo, no friction"] = [*off_by, rate, None, mujoco.__version__]
    return rows


def planar(_: str) -> dict[str, Row]:
    """Return the rows of the real-size instrument, one axis, held at a handle angle under a force across its tip."""
    handle, force, step = np.radians(20.0), 1.0, 5e-4
    inst = tn.load("real-size").axis("yaw")
    exact = float(scipy_peer.output_angle(inst, handle, force))
    smooth = inst.replace(friction={"law": "none"}, mismatch=None)
    moved, loads = np.linspace(0.0, handle, 2000), np.linspace(0.0, force, 2000)
    twin = tn.twin.Twin(inst, time_step=step)
    steps = 2000 / min(repeat(partial(twin.run, moved, force=loads), number=1, repeat=ROUNDS))
    few = partial(tn.twin.run_many, inst, np.tile(moved[:200], (MANY, 1)), force=loads[:200], every=200)
    many = MANY * 200 / min(repeat(few, number=1, repeat=3))
    own = abs(float(tn.statics.output_angle(smooth, handle, force)) - exact)
    rows: dict[str, Row] = {"Tenodesis, friction in the steps": [math.degrees(own), steps, many, tn.__version__]}
    settled = ChainPeer(smooth.expanded).settle([handle], [-force, 0, 0, 0, 0, 0]).angles[0]
    rate = chain_dynamics.steps_per_second(smooth.expanded, [-force, 0, 0, 0, 0, 0], time_step=step, seconds=0.5)
    rows["MuJoCo, no friction"] = [math.degrees(abs(settled - exact)), rate, None, mujoco.__version__]
    return rows


def exact_end() -> tuple[float, float, float]:
    """Return angle (rad) and place along x and z (m) of the backbone's end, as an elastica."""
    length, rigidity = BACKBONE.length, BACKBONE.rigidity
    s = np.linspace(0.0, length, 41)
    guess = np.array([MOMENT / rigidity * s, MOMENT + 0 * s, 0 * s, s])

    def rates(_: Any, y: Any) -> Any:
        return np.vstack([y[1] / rigidity, -FORCE * np.cos(y[0]), np.sin(y[0]), np.cos(y[0])])

    found = solve_bvp(rates, lambda a, b: np.array([a[0], a[2], a[3], b[1] - MOMENT]), s, guess, tol=1e-9)
    angle, _, x, z = map(float, found.y[:, -1])
    return angle, x, z


def rods_of(python: str, elements: Sequence[int], **options: Any) -> list[dict[str, Any] | None]:
    """Return what PyElastica makes of rods of so many elements, of the backbone unless options say otherwise."""
    given = {"length": BACKBONE.length, "rigidity": BACKBONE.rigidity} | options
    words = [word for name, value in given.items() for word in (f"--{name}", *np.atleast_1d(value).tolist())]
    return [of_peer(python, "elastica_rod.py", *words, "--elements", count) for count in elements]


def backbone(python: str) -> dict[str, Row]:
    """Return the rows of the backbone."""
    angle, x, z = exact_end()

    def row(place: tuple[float, float], own: float, *rates: float | str | None) -> Row:
        apart = math.hypot(place[0] - x, place[1] - z)
        return [100 * apart / BACKBONE.length, math.degrees(abs(own - angle)), *rates]

    rows: dict[str, Row] = {}
    wrench, pulled = [FORCE, 0.0, 0.0, 0.0, 0.0, 0.0], [MOMENT / BACKBONE.offset, 0.0]
    for arcs in (1, 4, 8):
        inst = backbone_of(arcs)
        joints = [joint.model_dump(exclude_unset=True) for joint in inst.as_given("joints")]
        joints[-1]["end_effector_length"] = 2e-7
        inst = inst.replace(joints=joints, tendons=list(inst.as_given("tendons")))
        strokes = statics.strokes_at_tensions(inst, pulled, wrench=wrench, axes="stem")
        solve: Callable[..., Any] = partial(
            chain.output_angles, inst, 0.0, np.tile(wrench, (MANY, 1)), strokes=strokes, axes="stem"
        )
        angles = solve()[0]
        end = tn.kinematics.tip_pose(inst, angles).position[0]
        rate = MANY / min(repeat(solve, number=1, repeat=ROUNDS))
        twin = tn.twin.Twin(backbone_of(arcs), time_step=5e-4)
        loads = np.zeros((MANY, 6))
        loads[:, 0] = FORCE * np.sin(2 * np.pi * 5e-4 * np.arange(MANY))
        run = partial(twin.run, np.zeros((MANY, 0)), wrench=loads)
        steps = MANY / min(repeat(run, number=1, repeat=ROUNDS))
        many = of_worlds(backbone_of(arcs), 5e-4, wrench=[FORCE, 0, 0, 0, 0, 0]) if arcs == ARCS else None
        name = f"Tenodesis, {arcs} arc{'s' * (arcs > 1)}"
        rows[name] = row((end[0], end[2]), float(angles.sum()), rate, steps, many, tn.__version__)
    rods = dict(zip((20, 40, 80), rods_of(python, (20, 40, 80), moment=MOMENT, force=(FORCE, 0.0, 0.0)), strict=True))
    for elements, found in rods.items():
        if found is not None:
            place = found["place"][0], found["place"][2]
            name = f"PyElastica, {elements} elements"
            rows[name] = row(place, found["angle"], 1 / found["seconds"], found["steps"], None, found["version"])
    if (coarse := rods[40]) is not None and (fine := rods[80]) is not None:
        x0, _, z0, angle0 = limit(coarse, fine)
        rows["PyElastica, extrapolated from 40 and 80"] = row((x0, z0), angle0, None, None, None, fine["version"])
    for parts in (4, 8):
        found = of_peer(
            python, "soromox_rod.py", "--length", BACKBONE.length, "--rigidity", BACKBONE.rigidity, "--offset",
            BACKBONE.offset, "--tensions", *(MOMENT / BACKBONE.offset, 0.0), "--force", FORCE, "--segments", parts,
            "--worlds", MANY,
        )  # fmt: skip
        if found is not None:
            rates = [found[key] for key in ("solves", "steps", "steps of worlds", "version")]
            rows[f"SoRoMoX, {parts} segments"] = row(found["place"], found["angle"], *rates)
    rate = chain_dynamics.steps_per_second(backbone_of(4), [FORCE, 0, 0, 0, 0, 0], seconds=0.5)
    rows["MuJoCo, four arcs as hinges, no friction"] = [None, None, None, rate, None, mujoco.__version__]
    return rows


def limit(coarse: dict[str, Any], fine: dict[str, Any]) -> Any:
    """Return place (m) and angle (rad) of a rod of endlessly many elements, by two of which one has twice as many.

    A clamp holds half an element too much, so that errors are in proportion to the length of an element.
    """
    one, two = (np.array([*found["place"], found["angle"]]) for found in (coarse, fine))
    return 2 * two - one


def segments(python: str) -> dict[str, Row]:
    """Return how far two segments in one plane are from PyElastica's rod, by the tensions of their tendons."""
    joints = [
        joint.model_dump(exclude_unset=True)
        for joint in tn.instrument.expanded("two-segment-continuum").as_given("joints")
    ]
    for joint in joints:
        joint["arcs"] = 4
    joints[-1]["end_effector_length"] = 2e-7
    whole = tn.instrument.in_arcs(tn.instrument.expanded("two-segment-continuum"), 1).replace(joints=joints)
    inst = tn.instrument.in_arcs(whole, 4)
    radius, rigidity, length = 1.8e-3, 1.2e-3, 50e-3
    rows: dict[str, Row] = {}
    for tensions, force in (
        ((12.0, 2.0, 2.0, 10.0), 0.0),
        ((2.0, 10.0, 14.0, 2.0), 0.0),
        ((2.0, 12.0, 14.0, 2.0), 0.3),
    ):
        near, far = radius * (tensions[0] - tensions[1]), radius * (tensions[2] - tensions[3])
        across, ends = (force, 0.0, 0.0), {"moment": far, "middle": near}
        rods = rods_of(python, (40, 80), length=length, rigidity=rigidity, force=across, seconds=0.4, **ends)
        if rods[0] is None or rods[1] is None:
            return {}
        x, _, z, angle = limit(rods[0], rods[1])
        wrench = [force, 0, 0, 0, 0, 0]
        strokes = statics.strokes_at_tensions(inst, tensions, wrench=wrench, axes="stem")
        angles = chain.output_angles(inst, 0.0, wrench, strokes=strokes, axes="stem")
        end = tn.kinematics.tip_pose(inst, angles).position[0]
        apart = 100 * math.hypot(end[0] - x, end[2] - z) / length
        name = f"{', '.join(f'{one:g}' for one in tensions)} N, {force:g} N across"
        rows[name] = [1e3 * end[0], 1e3 * end[2], apart, math.degrees(abs(angles.sum() - angle)), rods[1]["version"]]
    return rows


def space(python: str) -> dict[str, Row]:
    """Return how far a backbone in two planes that twists is from PyElastica's rod, by tensions and what acts."""
    shown = tn.load(Path(__file__).parents[1] / "examples" / "three_tendons.toml")
    joint = shown.expanded.as_given("joints")[0].model_copy(update={"end_effector_length": 2e-7})
    inst = shown.expanded.replace(joints=[joint], tendons=list(shown.expanded.as_given("tendons")))
    rows: dict[str, Row] = {}
    around = np.radians([0.0, 120.0, 240.0])
    for tensions, wrench in (
        ((12.0, 4.0, 2.0), [0.0] * 6),
        ((10.0, 4.0, 2.0), [0.0, 0.3, 0.0, 0.0, 0.0, 0.0]),
        ((10.0, 2.0, 5.0), [-0.2, 0.3, 0.0, 0.0, 0.0, 4e-3]),
    ):
        moment = joint.radius * np.array([-np.sin(around), np.cos(around)]) @ tensions
        coarse, fine = rods_of(
            python,
            (16, 32),
            length=joint.backbone_length,
            rigidity=joint.backbone_rigidity,
            torsion=joint.torsional_rigidity,
            moment=0.0,
            tendons=moment,
            force=wrench[:3],
            twist=wrench[5],
        )
        if coarse is None or fine is None:
            return {}
        place = 2 * np.array(fine["place"]) - coarse["place"]
        axis = 2 * np.array(fine["axis"]) - coarse["axis"]
        found = at_rest(inst, AtRest(tensions=np.array([tensions]), wrench=np.array([wrench])), "stem")
        own = found["direction"][0]
        apart = 100 * float(np.linalg.norm(found["position"][0] - place)) / joint.backbone_length
        off = math.degrees(math.atan2(float(np.linalg.norm(np.cross(own, axis))), float(own @ axis)))
        across, twist = math.hypot(*wrench[:2]), 1e3 * wrench[5]
        name = f"{', '.join(f'{one:g}' for one in tensions)} N, {across:.2g} N across, {twist:g} mN m about"
        rows[name] = [apart, off, math.degrees(math.acos(float(own[2]))), fine["version"]]
    return rows


WORKS: dict[str, tuple[str, Sequence[figures.Heading], Callable[[str], dict[str, Row]]]] = {
    "rope": ("simulator", ROPE, rope),
    "finger": ("simulator", FINGER, finger),
    "planar": ("simulator", PLANAR, planar),
    "backbone": ("simulator", TIP, backbone),
    "segments": ("tensions and force", SEGMENTS, segments),
    "space": ("tensions and force", SPACE, space),
}
"""What differs between the rows of each table, its columns, and what measures them."""


def main() -> None:
    """Print the tables, and write them into the file of figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--python", default=sys.executable, help="Python that has newton and pyelastica")
    parser.add_argument("--work", choices=[*WORKS], action="append", help="by default all")
    figures.arguments(parser)
    given = parser.parse_args()
    tn.set_threads(1)
    command = "python benchmarks/compared.py --python PYTHON_WITH_THE_PEERS --figures docs/results.json"
    for work in given.work or WORKS:
        of, columns, measure = WORKS[work]
        name, rows = f"peers_{work}", measure(given.python)
        print(f"\n{name}: {figures.headed(columns)}")
        for key, values in rows.items():
            print(f"  {key:44s} {figures.shown(values)}")
        if given.figures is not None:
            before = figures.read(given.figures).get(name)
            kept = {} if before is None else {key: row for key, row in before.rows.items() if len(row) == len(columns)}
            figures.keep(name, figures.FigureTable(command, of, columns, kept | rows), given.figures)


if __name__ == "__main__":
    main()
