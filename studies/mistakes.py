"""Mistakes of a laboratory named: eight kinds on three instruments, recorded by their twins.

Prints which are named, and how many intervals that are called identifiable exclude the truth.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import degrees
from pathlib import Path

import numpy as np

import tenodesis as tn
from tenodesis.errors import IdentificationError
from tenodesis.identification import fit, mistakes
from tenodesis.identification.formats.instrument_run import InstrumentRun, measured
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Problem
from tenodesis.identification.twin_model.problem import TwinProblem
from tenodesis.instrument import ShortForm, as_short_form
from tenodesis.units import STANDARD_GRAVITY

CONTINUUM = Path(__file__).parent.parent / "examples" / "continuum.toml"
FRICTION = {
    "friction.law": "capstan",
    "friction.vertex_coefficient": 0.1,
    "friction.sheath_coefficient": 0.1,
    "friction.sheath_bend": 1.0,
}
TRUTH = {
    "friction.vertex_coefficient": 0.13,
    "friction.sheath_coefficient": 0.07,
    "stiffness_ratio": 0.85,
    "pretension_ratio": 1.1,
    "mismatch.output_encoder_offset": float(np.radians(-1.4)),
}
STEP = 5e-4


def scaled(factor: float, *columns: str) -> Callable[[InstrumentRun], InstrumentRun]:
    """Return what multiplies columns."""

    def change(run: InstrumentRun) -> InstrumentRun:
        return replace(run, columns={**run.columns, **{name: factor * run[name] for name in columns}})

    return change


def swapped(run: InstrumentRun) -> InstrumentRun:
    """Return a recording with its tensions in the wrong order."""
    pair = {"tension_agonist": run["tension_antagonist"], "tension_antagonist": run["tension_agonist"]}
    return replace(run, columns={**run.columns, **pair})


def slowed(run: InstrumentRun) -> InstrumentRun:
    """Return a recording whose milliseconds were taken for seconds."""
    return replace(run, time=1e3 * run.time)


MISTAKES: dict[str, tuple[str, Callable[[InstrumentRun], InstrumentRun]]] = {
    "force's sign": ("the force has its sign reversed", scaled(-1, "force")),
    "tendons swapped": ("the columns of the two tendons are swapped", swapped),
    "kgf as N": (
        "the tensions are in kgf, not in N",
        scaled(1 / STANDARD_GRAVITY, "tension_agonist", "tension_antagonist"),
    ),
    "tip's radians as deg": (
        "the output angle is in radians, read as degrees",
        scaled(1 / degrees(1), "measured_output_angle"),
    ),
    "ms as s": ("the time is in ms, not in s", slowed),
    "handle reversed": (
        "the handle angle has its sign reversed",
        scaled(-1, "handle_angle", "measured_handle_angle"),
    ),
    "wrong instrument": ("another instrument", lambda run: run),
    "stiffness held wrong": ("stiffness_ratio is held at a wrong value", lambda run: run),
}


def instruments() -> dict[str, ShortForm]:
    """Return the three instruments as their files say."""
    found = {}
    for given in ("real-size", "scaled-up", str(CONTINUUM)):
        inst = as_short_form(tn.load(given)).planar[0]
        found[Path(given).stem] = inst.replace(mismatch=None, **FRICTION)
    return found


def recorded(inst: ShortForm, seconds: float) -> InstrumentRun:
    """Return a recording of an instrument's twin with the truth: cycles that fall, under a load that comes and goes."""
    keys = {name: value for name, value in TRUTH.items() if name.startswith(("friction", "mismatch"))}
    ratios = {f"mismatch.{name}": TRUTH[name] for name in ("stiffness_ratio", "pretension_ratio")}
    time = np.arange(1, int(seconds / STEP) + 1) * STEP
    way = 2 / np.pi * np.arcsin(np.sin(1.5 * np.pi * time)) * (1 - 0.6 * time / seconds)
    force = 0.5 * inst.conditions.forces[-1] * (1 - np.cos(4 * np.pi * time / seconds))
    run = tn.twin.Twin(inst.replace(**keys, **ratios), time_step=STEP).run(0.6 * inst.handle_range * way, force)
    return measured(run, name="recording")


def one(
    run: InstrumentRun, inst: ShortForm, others: dict[str, ShortForm], free: Sequence[str]
) -> tuple[str, dict[str, bool]]:
    """Return what is said, and of each parameter called identifiable whether its interval holds the truth."""

    def build(runs: Sequence[MeasuredRun], other: ShortForm | None) -> Problem:
        return TwinProblem(runs, "capstan", other or inst)

    def explained() -> mistakes.Explanation | None:
        return mistakes.explain([run], build, lambda _: free, instruments=others)

    try:
        problem = mistakes.answered(lambda: build([run], None), explained)
        result = mistakes.answered(lambda: fit(problem, free, train=[0], starts=1), explained)
    except IdentificationError as refusal:
        return f"refused: {refusal}", {}
    ratio = mistakes.unexplained_excess(problem, result, [0])
    said = "nothing"
    if ratio:
        found = explained()
        said = f"{ratio:.3g} times the noise, not explained" if found is None else found.statement
        result = mistakes.doubted(result, ratio, found)
    held = {
        name: result.interval_95[name][0] <= TRUTH[name] <= result.interval_95[name][1]
        for name in free
        if result.identifiability.identifiable[name]
    }
    return said, held


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--kinds", nargs="+", choices=MISTAKES, default=list(MISTAKES))
    given = parser.parse_args()
    seconds = given.seconds
    files = instruments()
    named = excluded = total = 0
    for place, (name, inst) in enumerate(files.items()):
        for kind in given.kinds:
            sentence, change = MISTAKES[kind]
            file = list(files.values())[(place + 1) % len(files)] if kind == "wrong instrument" else inst
            free = [one for one in TRUTH if kind != "stiffness held wrong" or one != "stiffness_ratio"]
            said, held = one(change(recorded(inst, seconds)), file, files, free)
            total += 1
            named += sentence in said
            excluded += sum(not inside for inside in held.values())
            print(f"{name:12} {kind:22} {'named' if sentence in said else 'NOT  '} {said}", flush=True)
    print(f"{named} of {total} named; {excluded} intervals called identifiable exclude the truth")


if __name__ == "__main__":
    main()
