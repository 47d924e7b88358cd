"""How often 95 % intervals hold the truth: parameters of a twin, backbones at rest, joints by commands and angles.

    python studies/coverage.py [--of TWIN ...] [--seeds 50]

Twin: cycles under a load that comes and goes, with noise and 12-bit encoders; every parameter reported as identifiable
is to be within its interval in at least 90 % of the seeds. Backbones: noise on places and angles. Joints: a random
coupling, play and offset, 60 s at 10, 50 and 100 Hz with white noise of 0.06 degrees.
"""

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import law
import numpy as np

import tenodesis as tn
from tenodesis.errors import ArgumentError
from tenodesis.identification import FORMATS, AtRest, Kinematic, fit, fit_at_rest, recorded, routing
from tenodesis.identification.any_instrument import at_rest
from tenodesis.identification.formats.instrument_run import TENDONS, InstrumentRun, checked
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.kinematic.model import ELEMENTS, LAWS
from tenodesis.identification.twin_model.problem import TwinProblem, problem
from tenodesis.instrument import FullForm, Instrument
from tenodesis.recording.simulation import record
from tenodesis.run import Array
from tenodesis.simulate import Cycles, Pretension, Protocol, campaign
from tenodesis.simulate.campaign import Column, Rows

EXAMPLES = Path(__file__).parents[1] / "examples"
STEP, SECONDS = 5e-4, 5.0  # s
SHARE_TARGET, WITHIN = 0.9, 1.96
"""Share of intervals that are to hold the truth, and half of their width in standard deviations."""
TRUTH = {
    "stiffness_ratio": 0.85,
    "handle_length_share": 0.16,
    "pretension_ratio": 1.1,
    "friction.vertex_coefficient": 0.13,
    "friction.sheath_coefficient": 0.07,
    "mismatch.output_encoder_offset": float(np.radians(-1.4)),
}


def judged(name: str, interval: tuple[float, float], truth: float, *, identifiable: bool = True) -> dict[str, Any]:
    """Return whether an interval of an identifiable parameter holds the truth, and the error over the deviation."""
    low, high = interval
    error = 2 * WITHIN * ((low + high) / 2 - truth) / (high - low) if identifiable else np.nan
    return {"name": name, "covered": low <= truth <= high, "error": error, "identifiable": identifiable}


def commands(inst: Instrument, seconds: float) -> tuple[Array, Array]:
    """Return handle angle and force: cycles of falling amplitude under a load that comes and goes."""
    moment = np.arange(1, round(seconds / STEP) + 1) * STEP
    way = 2 / np.pi * np.arcsin(np.sin(1.5 * np.pi * moment)) * (1 - 0.6 * moment / seconds)
    return 0.75 * inst.handle_range * way, 0.5 - 0.5 * np.cos(4 * np.pi * moment / seconds)


def cycled(inst: Instrument, seed: int, seconds: float = SECONDS, *, commanded: bool = True) -> InstrumentRun:
    """Return the sensor readings of an instrument's twin, with noise and 12-bit encoders."""
    run = tn.twin.Twin(inst, time_step=STEP, seed=seed).run(*commands(inst, seconds))
    columns = {name: run[name] for name in ("measured_handle_angle", "measured_output_angle", "force")}
    # Without a command the handle angle is that of its encoder.
    columns["handle_angle"] = run["commanded_handle_angle"] if commanded else columns.pop("measured_handle_angle")
    for n, tendon in enumerate(TENDONS):
        columns[f"tension_{tendon}"] = run["measured_tension"][:, n]
        columns[f"spool_{tendon}"] = run["measured_spool_angle"][:, n]
    return checked(f"seed {seed}", run.time, columns)


def tightened(inst: Instrument, seed: int) -> InstrumentRun:
    """Return a recording that begins with slack tendons, which the motors wind up."""
    phases = (
        Pretension(),
        Cycles(output_amplitude=math.radians(50), symmetric=True, speed=math.radians(25), count=1, force=0.0),
        Cycles(output_amplitude=math.radians(40), symmetric=True, speed=math.radians(25), count=1, force=1.0),
    )
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        record(inst, Protocol(name="slack", phases=phases), path, time_step=STEP, seed=seed)
        loaded = FORMATS["mcap"].load(path)
    assert isinstance(loaded, InstrumentRun)
    return loaded


def posed(run: InstrumentRun, nominal: Instrument) -> TwinProblem:
    """Return the problem of a run, starting from the file's values."""
    return problem([run], [], law="capstan", instrument=nominal)


def instruments() -> tuple[Instrument, Instrument]:
    """Return the instrument as its file has it, and the true one."""
    nominal = tn.load("scaled-up").replace(mismatch=None, **{"friction.sheath_bend": 1.0})
    ratios = {f"mismatch.{name}": TRUTH[name] for name in ("stiffness_ratio", "pretension_ratio")}
    own = {name: value for name, value in TRUTH.items() if name.startswith(("friction", "mismatch"))}
    return nominal, nominal.replace(**ratios, **own)


def of_twin(seed: int, run: Callable[[Instrument, int], InstrumentRun], names: Sequence[str] = ()) -> Iterable[Any]:
    """Return the parameters of a recording that are open: those named, or all."""
    nominal, true = instruments()
    one = posed(run(true, seed), nominal)
    # Parameters without an entry in TRUTH are as in the file.
    truth = {parameter.name: TRUTH.get(parameter.name, parameter.start) for parameter in one.parameters}
    found = fit(one, [*(names or truth)], train=[0], starts=1)
    for name, interval in found.interval_95.items():
        yield judged(name, interval, truth[name], identifiable=found.identifiability.identifiable[name])


UNKNOWNS = {
    "backbone": ("bend.backbone_rigidity", "agonist.bend.radius", "antagonist.bend.radius"),
    "three_tendons": ("bend.backbone_rigidity", "bend.torsional_rigidity", "a.bend.radius", "b.bend.angle"),
}
READINGS, PLACE, ANGLE = 20, 2e-4, 5e-3
"""Of each fit, and the noise of a coordinate, m, and of an angle, rad."""


@functools.cache
def posture(file: str) -> tuple[FullForm, AtRest, dict[str, Any], dict[str, float]]:
    """Return a backbone, random strokes and wrenches, what they make of it, and the truth."""
    inst = tn.instrument.expanded(tn.load(EXAMPLES / f"{file}.toml"))
    rng = np.random.default_rng(0)
    wrench = np.zeros((READINGS, 6))
    wrench[:, 0] = rng.uniform(-0.5, 0.5, READINGS)
    if len(inst.tendons) > 2:
        wrench[:, 1] = rng.uniform(-0.5, 0.5, READINGS)
        wrench[:, 5] = rng.uniform(-0.01, 0.01, READINGS)
    data = AtRest(strokes=rng.uniform(-1e-3, 2e-3, (READINGS, len(inst.tendons))), wrench=wrench)
    exact = at_rest(inst, data)
    # Without noise the search ends where it starts, at the truth.
    found = fit_at_rest(inst, data._replace(**exact), UNKNOWNS[file]).unknowns
    return inst, data, exact, {name: one.value for name, one in found.items()}


def of_posture(seed: int, file: str) -> Iterable[Any]:
    """Return the unknowns of a backbone at rest."""
    inst, data, exact, truth = posture(file)
    noise = np.random.default_rng(seed)
    noisy = data._replace(
        position=exact["position"] + PLACE * noise.standard_normal(exact["position"].shape),
        angles=exact["angles"] + ANGLE * noise.standard_normal(exact["angles"].shape),
    )
    for name, one in fit_at_rest(inst, noisy, UNKNOWNS[file]).unknowns.items():
        yield judged(name, (one.low, one.high), truth[name])


JOINTS = ("roll", "pitch", "yaw")
TICK, NOISE = 0.02, 1e-3  # s, rad


def simulated(
    seed: int, law: str, *, samples: int = 3000, motion: int = 0, tick: float = TICK
) -> tuple[MeasuredRun, dict[str, float]]:
    """Return a recording of joints with a law, and their parameters; motions and noise of one seed are several."""
    draw, moves = np.random.default_rng(seed), np.random.default_rng([seed, motion])
    time: Array = np.linspace(0, tick * (samples - 1), samples)
    command = {
        joint: sum(
            amplitude * np.sin(2 * np.pi * frequency * time + phase)
            for amplitude, frequency, phase in zip(
                moves.uniform(0.1, 0.5, 3), moves.uniform(0.03, 0.3, 3), moves.uniform(0, 6, 3), strict=True
            )
        )
        for joint in JOINTS
    }
    truth: dict[str, float] = {}
    angle: dict[str, Array] = {}
    kept: dict[str, Array] = {}
    for place, joint in enumerate(JOINTS):
        truth[f"offset.{joint}"] = draw.normal(0, 0.05)
        truth[f"gain.{joint}"] = draw.normal(1, 0.05)
        moved = truth[f"offset.{joint}"] + truth[f"gain.{joint}"] * command[joint]
        for other in JOINTS:
            if other != joint:
                truth[f"coupling.{joint}.{other}"] = draw.normal(0, 0.1)
                moved = moved + truth[f"coupling.{joint}.{other}"] * command[other]
        for other in JOINTS[:place] if law == "passed" else ():
            truth[f"follow.{joint}.{other}"] = draw.normal(0, 0.5)
            moved = moved + truth[f"follow.{joint}.{other}"] * kept[other]
        plays = np.zeros(1)
        if law != "none":
            truth[f"play.{joint}"] = draw.uniform(0.03, 0.15)
            plays = np.full(1, truth[f"play.{joint}"])
        if law == "soft":
            truth[f"softness.{joint}"] = draw.uniform(0.3, 0.8)
            plays = plays * (1 - truth[f"softness.{joint}"] * np.linspace(0, 1, ELEMENTS))
        angle[joint] = np.mean([_behind(moved, one / 2) for one in plays], axis=0)
        kept[joint] = angle[joint] - moved
    measured = {joint: one + moves.normal(0, NOISE, samples) for joint, one in angle.items()}
    return recorded(time, command, measured), truth


def _behind(moved: Array, half: float) -> Array:
    angle, found = moved[0], []
    for one in moved.tolist():
        angle = min(max(angle, one - half), one + half)
        found.append(angle)
    return np.array(found)


def of_joints(seed: int, law: str, rate: int = 50) -> Iterable[Any]:
    """Return the parameters of joints by kind, from samples at a rate, Hz."""
    run, truth = simulated(seed, law, samples=60 * rate, tick=1 / rate)
    for name, interval in fit(Kinematic([run], law=law), train=[0], starts=1).interval_95.items():
        if name in truth:
            yield judged(name.partition(".")[0], interval, truth[name])


ROUTED = ("needle-driver", "maryland-dissector", "two-segment-continuum", "hybrid-real-size")
ROUTED_SECONDS, COEFFICIENT = 2.0, 0.12
BENDING, PUSHING, OFFSET = 0.35, 0.5, 0.01  # rad, N, rad
LET_OUT = 1.0
"""Time in which spools let tendons out, s."""


def routed(seed: int, name: str, seconds: float = ROUTED_SECONDS) -> tuple[FullForm, FullForm, tn.Run]:
    """Return an instrument, a true one with other tendons and arms, and its twin's run: joints bend, loads turn."""
    inst = tn.instrument.expanded(tn.load(name))
    if inst.friction.law == "none":
        same = dict.fromkeys(("friction.vertex_coefficient", "friction.sheath_coefficient"), COEFFICIENT)
        inst = inst.replace(**{"friction.law": "capstan", "friction.sheath_bend": float(np.radians(20))}, **same)
    rng = np.random.default_rng(seed)
    # stiffness and pretension of tendons, arms, coefficients: within a share of the file's values
    spread = {"stiffness": 0.2, "pretension": 0.1, "radius": 0.05, "coefficient": 0.2}
    drawn = {}
    for parameter in routing.problem([], [], law="capstan", instrument=inst).parameters:
        share = next((share for key, share in spread.items() if parameter.name.endswith(key)), 0.0)
        drawn[parameter.name] = parameter.start * rng.uniform(1 - share, 1 + share)
    true = routing.problem([], [], law="capstan", instrument=inst).instrument(np.array([*drawn.values()]))
    return inst, true, excited(true, inst, seed, seconds)


def excited(
    true: FullForm, inst: FullForm, seed: int, seconds: float = ROUTED_SECONDS, *, slack: float = 0.0, **given: Any
) -> tn.Run:
    """Return a run of a true instrument: joints bend, by handle or by motors as the file has it, and loads turn.

    Last, spools let so much of all tendons out, m, from which load cells read what they are off. given: of the run.
    """
    try:
        twin = tn.twin.Twin(true, time_step=STEP, seed=seed)
    except ArgumentError:
        twin = tn.twin.Twin(true, time_step=STEP / 2, seed=seed)
    step = twin.time_step
    time = np.arange(round(seconds / step)) * step
    grown = np.clip(time / 0.5, 0, 1)

    def wave(place: int, least: float) -> Array:
        return grown * np.sin(2 * np.pi * (least + 0.09 * place) * time + place)

    columns = [BENDING * wave(n, 0.3) for n in range(len(inst.handle_joints))]
    handle = np.stack(columns, axis=1) if columns else np.zeros((time.size, 0))
    bent = np.zeros((time.size, len(inst.tip_joints)))
    for place, arcs in enumerate(inst.arc_places.values()):
        bent[:, arcs] = (BENDING * wave(place, 0.23) / len(arcs))[:, np.newaxis]
    wrench = np.zeros((time.size, 6))
    wrench[:, :2] = PUSHING * np.stack([wave(0, 0.45), wave(1, 0.6)], axis=1)
    # without a handle the motors bend the joints
    bends = 0 if inst.handle_joints else -np.gradient(bent @ inst.tendon_arms("tip").T, step, axis=0)
    velocity = bends / twin.spool_radius + np.zeros((time.size, len(inst.tendons)))
    if slack:
        count = round(LET_OUT / step)
        handle, wrench = (np.concatenate([rows, np.repeat(rows[-1:], count, axis=0)]) for rows in (handle, wrench))
        share = 2 * np.sin(np.pi * np.arange(count) / count) ** 2 / LET_OUT
        own = np.repeat(-slack / twin.spool_radius * share[:, np.newaxis], velocity.shape[1], axis=1)
        velocity = np.concatenate([velocity, own])
    return twin.run(handle, wrench=wrench, spool_velocity=velocity, **given)


def sensed(run: tn.Run, inst: FullForm, seed: int, *, by_encoders: bool) -> tuple[routing.RoutingRun, dict[str, float]]:
    """Return a run's readings with errors of load cells and offsets of joints' encoders, and these offsets."""
    rng = np.random.default_rng([seed, 1])
    read = routing.of_run(run, inst)
    columns = dict(read.columns)
    if by_encoders:
        columns = {name: row for name, row in columns.items() if not name.startswith("spool_")}
        columns |= {
            f"spool_angle.{name}": row
            for name, row in zip(run.tendons, run.by_column("measured_spool_angle").T, strict=True)
        }
    for tendon, sensor in zip(inst.tendons, inst.tension_sensors, strict=True):
        gain, offset = 1 + sensor.gain_error * rng.standard_normal(), sensor.offset * rng.standard_normal()
        columns[f"tension.{tendon.name}"] = gain * columns[f"tension.{tendon.name}"] + offset
    offsets = {}
    for bend, arcs in inst.arc_places.items():
        offsets[f"{bend}.encoder_offset"] = OFFSET * rng.standard_normal()
        for joint in [inst.tip_joints[arc].name for arc in arcs]:
            columns[f"output_angle.{joint}"] = columns[f"output_angle.{joint}"] + offsets[
                f"{bend}.encoder_offset"
            ] / len(arcs)
    return routing.RoutingRun(read.name, read.time, columns, read.notes, instrument=inst), offsets


def of_routing(seed: int, name: str, *, by_encoders: bool = False) -> Iterable[Any]:
    """Return the unknowns of all joints and tendons of an instrument by kind."""
    inst, true, run = routed(seed, name)
    readings, offsets = sensed(run, inst, seed, by_encoders=by_encoders)
    one = routing.problem([readings], [], law="capstan")
    found = fit(one, train=[0], starts=1)
    for parameter, interval in found.interval_95.items():
        owner, _, key = parameter.rpartition(".")
        yield judged(
            parameter if owner in {"friction", "dynamics"} else key,
            interval,
            offsets.get(parameter, one.value(true, parameter)),
            identifiable=found.identifiability.identifiable[parameter],
        )


class CoverageCase(NamedTuple):
    """What is fitted of a seed, and over how many seeds."""

    words: str
    fitted: Callable[[int], Iterable[Any]]
    seeds: int


NOISY = f"{SECONDS:g} s with noise and 12-bit encoders"
CASES = {
    "twin": CoverageCase(NOISY, functools.partial(of_twin, run=cycled, names=[*TRUTH]), 100),
    "twin-open": CoverageCase(f"{NOISY}, all open", functools.partial(of_twin, run=cycled), 20),
    "twin-encoder": CoverageCase(
        f"{NOISY}, handle by its encoder alone, all open",
        functools.partial(of_twin, run=functools.partial(cycled, commanded=False)),
        20,
    ),
    "twin-slack": CoverageCase("tendons slack at first", functools.partial(of_twin, run=tightened, names=[*TRUTH]), 20),
    **{file: CoverageCase(f"{file} at rest", functools.partial(of_posture, file=file), 50) for file in UNKNOWNS},
    **{one: CoverageCase(f"{one}, all tendons", functools.partial(of_routing, name=one), 50) for one in ROUTED},
    **{
        f"{one}-encoders": CoverageCase(
            f"{one}, all tendons, spools by their encoders",
            functools.partial(of_routing, name=one, by_encoders=True),
            20,
        )
        for one in ROUTED[:3]
    },
    **{f"joints-{one}": CoverageCase(f"joints, {one}", functools.partial(of_joints, law=one), 50) for one in LAWS[1:]},
    **{
        f"joints-{one}-{rate}": CoverageCase(
            f"joints, {one}, {rate} Hz", functools.partial(of_joints, law=one, rate=rate), 50
        )
        for one in LAWS[1:]
        for rate in (10, 100)
    },
}
COVERAGE = [
    Column("intervals, ", len, form="d"),
    Column("hold the truth, ", "covered", form=".1%"),
    Column("error over deviation, ", "error", form="+.2f"),
    Column("±, ", "error", np.std),
    Column(
        f"target {100 * SHARE_TARGET:g} %",
        lambda rows: "reached" if rows["covered"].mean() >= SHARE_TARGET else "MISSED",
        form="",
    ),
]


def trial(case: str, seed: int) -> dict[str, Any]:
    """Return the intervals of a seed."""
    return {"intervals": [*CASES[case].fitted(seed)]}


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--of", nargs="+", choices=[*CASES], default=[*CASES], metavar="CASE")
    parser.add_argument("--seeds", type=int, help="by default 20 to 100")
    options = parser.parse_args()
    for name in options.of:
        case = CASES[name]
        cases = campaign.cases(case=[name], seed=range(options.seeds or case.seeds))
        rows = campaign.run(trial, cases, case.words, results=options.results)
        every = Rows(one for row in rows for one in row["intervals"])
        intervals = every.where(identifiable=True)
        never = sorted({*every["name"]} - {*intervals["name"]})
        print(f"{case.words}: {len(rows)} seeds; called identifiable in none: {', '.join(never) or 'no parameter'}")
        groups = intervals.by("name") | {"all": intervals}
        law.show(options, f"coverage_{name.replace('-', '_')}", groups, COVERAGE, "parameter", unit="")


if __name__ == "__main__":
    main()
