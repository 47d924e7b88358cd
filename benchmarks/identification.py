"""Accuracy and speed of identification from recordings of a twin, whose true parameters are known.

Coverage: every parameter reported as identifiable is within its 95 % interval in at least 90 % of the seeds.
Speed: the peer is the same fit by the same optimiser with differences (two points a parameter) for derivatives.
"""

import os

# One core, whatever library multiplies matrices.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from timeit import timeit
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

import tenodesis as tn
from tenodesis.identification import FORMATS, fit
from tenodesis.identification.formats.instrument_run import TENDONS, InstrumentRun, checked
from tenodesis.identification.problem import scales
from tenodesis.identification.twin_model.problem import TwinProblem, problem
from tenodesis.instrument import Instrument
from tenodesis.recording.simulation import record
from tenodesis.run import Array
from tenodesis.simulate import Cycles, Pretension, Protocol, campaign
from tenodesis.simulate.campaign import Column, Rows

STEP = 5e-4
SEEDS = 100
FEWER_SEEDS = 20
"""For the cases whose fits take longer."""
SECONDS = 5.0
SHARE_TARGET = 0.9
LONG_SECONDS = 20.0
ROUNDS = 3
SECONDS_TARGET = 5.0

TRUTH = {
    "stiffness_ratio": 0.85,
    "handle_length_share": 0.16,
    "pretension_ratio": 1.1,
    "friction.vertex_coefficient": 0.13,
    "friction.sheath_coefficient": 0.07,
    "mismatch.output_encoder_offset": float(np.radians(-1.4)),
}


def commands(inst: Instrument, seconds: float) -> tuple[Array, Array]:
    """Return handle angle and force: cycles of falling amplitude under a load that comes and goes."""
    moment = np.arange(1, round(seconds / STEP) + 1) * STEP
    way = 2 / np.pi * np.arcsin(np.sin(1.5 * np.pi * moment)) * (1 - 0.6 * moment / seconds)
    return 0.75 * inst.handle_range * way, 0.5 - 0.5 * np.cos(4 * np.pi * moment / seconds)


def recorded(inst: Instrument, seconds: float, seed: int, *, commanded: bool = True) -> InstrumentRun:
    """Return the sensor readings of an instrument's twin, with noise and 12-bit encoders."""
    run = tn.twin.Twin(inst, time_step=STEP, seed=seed).run(*commands(inst, seconds))
    columns = {name: run[name] for name in ("measured_handle_angle", "measured_output_angle", "force")}
    # without a command the handle angle is that of its encoder
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


def searched(one: TwinProblem, *, exact: bool) -> Array:
    """Return what the optimiser finds of the same parameters, with exact derivatives or by differences."""
    parameters = one.parameters
    places = [n for n, parameter in enumerate(parameters) if parameter.name in TRUTH]
    start = np.array([parameter.start for parameter in parameters])

    def full(at: Array) -> Array:
        values = start.copy()
        values[places] = at
        return values

    found = least_squares(
        lambda at: one.residuals(full(at), 0),
        start[places],
        jac=(lambda at: one.derivatives(full(at), 0, places)) if exact else "2-point",
        bounds=([parameters[n].lower for n in places], [parameters[n].upper for n in places]),
        x_scale=scales(parameters, start)[places],
        ftol=1e-9,
        xtol=1e-9,
        gtol=1e-9,
    )
    return np.asarray(found.x)


def instruments() -> tuple[Instrument, Instrument]:
    """Return the instrument as its file has it, and the true one."""
    nominal = tn.load("scaled-up").replace(mismatch=None, **{"friction.sheath_bend": 1.0})
    ratios = {f"mismatch.{name}": TRUTH[name] for name in ("stiffness_ratio", "pretension_ratio")}
    own = {name: value for name, value in TRUTH.items() if name.startswith(("friction", "mismatch"))}
    return nominal, nominal.replace(**ratios, **own)


class Recorded(NamedTuple):
    """How a run is recorded, which parameters are fitted (all if none are named), and over how many seeds."""

    run: Callable[[Instrument, int], InstrumentRun]
    names: Sequence[str] | None
    seeds: int


NOISY = f"{SECONDS:g} s with noise and 12-bit encoders"
CASES = {
    NOISY: Recorded(lambda inst, seed: recorded(inst, SECONDS, seed), [*TRUTH], SEEDS),
    f"{NOISY}, all open": Recorded(lambda inst, seed: recorded(inst, SECONDS, seed), None, FEWER_SEEDS),
    f"{NOISY}, handle by its encoder alone, all open": Recorded(
        lambda inst, seed: recorded(inst, SECONDS, seed, commanded=False), None, FEWER_SEEDS
    ),
    "tendons slack at first": Recorded(tightened, [*TRUTH], FEWER_SEEDS),
}


def trial(case: str, seed: int) -> dict[str, Any]:
    """Return of each identifiable parameter whether its interval covers the truth, and its error over its deviation."""
    (nominal, true), how = instruments(), CASES[case]
    one = posed(how.run(true, seed), nominal)
    # Parameters without an entry in TRUTH are as in the file.
    truth = {parameter.name: TRUTH.get(parameter.name, parameter.start) for parameter in one.parameters}
    found = fit(one, [*(how.names or truth)], train=[0], starts=1)
    parameters = [
        {"name": name, "covered": low <= truth[name] <= high, "error": off / found.std[name]}
        for name, (low, high) in found.interval_95.items()
        for off in (found.values[name] - truth[name],)
        if found.identifiability.identifiable[name]
    ]
    return {"parameters": parameters, "open": [*(how.names or truth)]}


COVERAGE = [
    Column("identifiable in", len, form="d"),
    Column("within its 95 % interval", "covered", form=".1%"),
    Column("error over deviation", "error", form="+.2f"),
    Column("±", "error", np.std),
    Column(
        f"target {100 * SHARE_TARGET:g} %",
        lambda rows: "reached" if rows["covered"].mean() >= SHARE_TARGET else "MISSED",
        form="",
    ),
]


def coverage(case: str) -> None:
    """Print how often identifiable parameters are within their intervals."""
    fitted = campaign.run(trial, campaign.cases(case=[case], seed=range(CASES[case].seeds)), case)
    parameters = Rows(one for row in fitted for one in row["parameters"])
    never = {name for row in fitted for name in row["open"]} - {*parameters["name"]}
    print(f"{case}: {len(fitted)} seeds; called identifiable in none: {', '.join(sorted(never)) or 'no parameter'}")
    print(campaign.table(parameters.by("name"), COVERAGE, "parameter"))


def speed(nominal: Instrument, true: Instrument) -> None:
    """Print how long one fit takes, and its search alone with exact derivatives and with differences."""
    complete: list[float] = []
    times: dict[bool, list[float]] = {True: [], False: []}
    apart = 0.0
    for seed in range(ROUNDS):
        run = recorded(true, LONG_SECONDS, seed)
        complete.append(
            timeit(lambda: fit(posed(run, nominal), list(TRUTH), train=[0], starts=1), number=1)  # noqa: B023
        )
        found = []
        for exact, spent in times.items():
            one = posed(run, nominal)
            spent.append(timeit(lambda: found.append(searched(one, exact=exact)), number=1))  # noqa: B023
        apart = max(apart, float(np.abs(found[0] - found[1]).max()))
    ratios = np.array(times[False]) / times[True]
    print(f"{LONG_SECONDS:g} s at {1 / STEP:g} Hz, {len(TRUTH)} parameters, one core, one start, {ROUNDS} recordings")
    for name, spent in (
        ("all of it, with every statistic", complete),
        ("search, exact derivatives", times[True]),
        ("search, differences of two points", times[False]),
    ):
        print(f"  {name:<36} mean {np.mean(spent):6.2f} s   worst {max(spent):6.2f} s")
    verdict = "reached" if max(complete) <= SECONDS_TARGET else "MISSED"
    print(f"  target {SECONDS_TARGET:g} s {verdict}; exact derivatives faster ", end="")
    print(f"{ratios.mean():.2f} times, worst {ratios.min():.2f}; both find the same to {apart:.0e}")


def main() -> None:
    speed(*instruments())
    for case in CASES:
        coverage(case)


if __name__ == "__main__":
    main()
