"""Jaw torque and angle of a measured da Vinci tool from its spindle: our model against gradient boosting.

O'Neill, Stephens and Kowalewski (IEEE RA-L 3(4):3027-3034, 2018) give 0.37 deg and 4.42 mN m RMSE, by neural networks
on samples of all runs split at random. That split is made here, and beside it splits whose held-out runs differ from
the fitted ones in load, frequency, posture or tool. The peer is scikit-learn's histogram gradient boosting with the
same inputs: spindle angle, torque or current, and speed; ours is given angle and torque or current.

    python studies/force_measured.py DATA [--other FOLDER] [--out FOLDER]

DATA holds the folders davinci-tool and davinci-posture; both stay where they are. Needs scikit-learn.
"""

import os

# One core, whatever library multiplies matrices.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tenodesis.identification.datasets import davinci_posture, davinci_tool
from tenodesis.identification.force import ForceModel, fit_force
from tenodesis.identification.force.fitting import fit_series
from tenodesis.identification.force.model import SIGNALS, Series, Signal, bench_of, checked, series_of
from tenodesis.identification.force.report import RunResult, Traces, assess, bounds_of, pooled, traces
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.report import page, style
from tenodesis.run import Array

PUBLISHED = "0.37° and 4.42 mN·m, neural networks, samples of all runs at random (O'Neill et al. 2018)"
BLOCK = 0.01  # s, between the samples of the peer
SPEED_TIME = 0.1  # s
SHARE = 0.2  # held out at random
SEED = 0


class Row(NamedTuple):
    """Errors of ours and of the peer on held-out samples, mN m and deg, and the coverage of our intervals."""

    split: str
    signal: Signal
    held_out: str
    torque: float
    angle: float
    torque_covered: float
    angle_covered: float
    peer_torque: float
    peer_angle: float


def features(series: Series, signal: Signal) -> Array:
    """Return the inputs of the peer, (n, 3)."""
    lag = max(1, round(SPEED_TIME / series.step))
    before = np.concatenate([np.repeat(series.angle[0], lag), series.angle[:-lag]])
    near = series.torque if signal == "torque" else series.current
    return np.column_stack([series.angle, near, (series.angle - before) / (lag * series.step)])


def peer(train: Sequence[Series], signal: Signal, used: Sequence[Array]) -> Callable[[Series], tuple[Array, Array]]:
    """Return gradient boosting of torque and angle, fitted to the samples of runs that are used."""
    from sklearn.ensemble import HistGradientBoostingRegressor  # noqa: PLC0415 - only benchmarks need it

    inputs = np.vstack([features(one, signal)[keep] for one, keep in zip(train, used, strict=True)])
    pitches = np.concatenate(
        [np.full(int(keep.sum()), one.pitch or 0.0) for one, keep in zip(train, used, strict=True)]
    )
    inputs = np.column_stack([inputs, pitches])
    models = []
    for name in ("far_torque", "far_angle"):
        wanted = np.concatenate([getattr(one, name)[keep] for one, keep in zip(train, used, strict=True)])
        models.append(HistGradientBoostingRegressor(random_state=SEED).fit(inputs, wanted))

    def predict(series: Series) -> tuple[Array, Array]:
        given = np.column_stack([features(series, signal), np.full(series.time.size, series.pitch or 0.0)])
        return models[0].predict(given), models[1].predict(given)

    return predict


def errors(series: Series, torque: Array, angle: Array, used: Array) -> tuple[float, float]:
    """Return the mean squares of the errors, (mN m)^2 and deg^2."""
    off = np.degrees(series.far_angle - angle)[used]
    if series.pitch is not None:
        off = off - off.mean()
    return float(np.mean((1e3 * (series.far_torque - torque)[used]) ** 2)), float(np.mean(off**2))


def held_out(split: str, train: list[MeasuredRun], test: list[MeasuredRun], signal: Signal) -> Row:
    """Return the errors on runs that were held out."""
    model = fit_force(train, signal)
    results = [assess(traces(model, one)) for one in test]
    fitted = [series_of(checked(one, signal), model.bench, interval=BLOCK) for one in train]
    boosted = peer(fitted, signal, [one.fitted for one in fitted])
    squares = []
    for one in (series_of(checked(one, signal), model.bench, interval=BLOCK) for one in test):
        squares.append(errors(one, *boosted(one), one.counted))
    return _row(split, signal, test, pooled(results), squares)


def at_random(runs: list[MeasuredRun], signal: Signal) -> Row:
    """Return the errors on a fifth of the samples of all runs, drawn at random; the rest were fitted."""
    usable = [checked(one, signal) for one in runs]
    bench = bench_of(usable)
    chance = np.random.default_rng(SEED)
    series = [series_of(one, bench, interval=BLOCK) for one in usable]
    out = [one.counted & (chance.random(one.time.size) < SHARE) for one in series]
    keep = [one.fitted & ~left for one, left in zip(series, out, strict=True)]
    model = fit_series([replace(one, fitted=used) for one, used in zip(series, keep, strict=True)], bench, signal)
    boosted = peer(series, signal, keep)
    ours, theirs = [], []
    for one, left in zip(series, out, strict=True):
        ours.append(assess(Traces(replace(one, counted=left, fitted=one.fitted & left), model.estimate_series(one))))
        theirs.append(errors(one, *boosted(one), left))
    return _row("samples at random", signal, runs, pooled(ours), theirs)


def _row(
    split: str, signal: Signal, test: Sequence[MeasuredRun], ours: RunResult, theirs: Sequence[tuple[float, float]]
) -> Row:
    torque, angle = np.sqrt(np.mean(theirs, axis=0)).tolist()
    return Row(
        split,
        signal,
        " ".join(Path(one.name).stem for one in test),
        1e3 * ours.torque_rmse,
        math.degrees(ours.angle_rmse),
        ours.torque_covered,
        ours.angle_covered,
        torque,
        angle,
    )


class Calibrated(NamedTuple):
    """Errors at a posture after one recording of it, over each in turn, and of other models, mN m and deg."""

    posture: str
    signal: Signal
    carried_torque: float
    carried_angle: float
    torque: float
    angle: float
    torque_covered: float
    angle_covered: float
    full_torque: float
    full_angle: float
    undetermined: tuple[str, ...]
    """After the first recording."""


def calibrated(tool: ForceModel, full: ForceModel, posture: str, runs: list[MeasuredRun]) -> Calibrated:
    """Return the errors on a posture's other recordings, after one of them recalibrated another session's model.

    `full` was fitted to all recordings of all postures; the model that is only carried over has the offsets of the
    one recording, without which its sensors' zeros are unknown.
    """
    own: list[RunResult] = []
    carried: list[RunResult] = []
    weak = []
    for first in runs:
        others = [one for one in runs if one is not first]
        model = fit_force([first], tool.signal, prior=tool)
        weak.append(model.undetermined())
        own += [assess(traces(model, one)) for one in others]
        bare = fit_force([first], tool.signal, prior=tool, groups=("offset",))
        carried += [assess(traces(bare, one)) for one in others]
    found, before, fitted = (pooled(rows) for rows in (own, carried, [assess(traces(full, one)) for one in runs]))
    return Calibrated(
        posture,
        tool.signal,
        1e3 * before.torque_rmse,
        math.degrees(before.angle_rmse),
        1e3 * found.torque_rmse,
        math.degrees(found.angle_rmse),
        found.torque_covered,
        found.angle_covered,
        1e3 * fitted.torque_rmse,
        math.degrees(fitted.angle_rmse),
        weak[0],
    )


def tool_runs(folder: Path) -> dict[str, MeasuredRun]:
    """Return the recordings of a tool by name, XY: X is 0 at 0.1 Hz, Y the load level."""
    return {path.stem: davinci_tool.load(path) for path in sorted(folder.glob("*.TXT"))}


def posture_runs(folder: Path) -> dict[str, list[MeasuredRun]]:
    """Return the recordings of each pitch."""
    found: dict[str, list[MeasuredRun]] = {}
    for path in sorted(folder.glob("*.TXT")):
        found.setdefault(re.sub(r"_\d+$", "", path.stem), []).append(davinci_posture.load(path))
    return found


def splits(
    tool: dict[str, MeasuredRun], postures: dict[str, list[MeasuredRun]], other: dict[str, MeasuredRun]
) -> list[tuple[str, list[MeasuredRun], list[MeasuredRun]]]:
    """Return the splits: name, fitted and held-out runs."""
    slow = {name: one for name, one in tool.items() if name.startswith("0")}
    even = [one for name, one in slow.items() if name[-1] in "02468"]
    odd = [one for name, one in slow.items() if name[-1] not in "02468"]
    fast = [one for name, one in tool.items() if not name.startswith("0")]
    found = [("loads", even, odd), ("frequencies", list(slow.values()), fast), ("loads, frequencies", even, fast)]
    every = [one for runs in postures.values() for one in runs]
    if every:
        low = [one for runs in postures.values() for one in runs[::2]]
        found.append(("loads, three postures", low, [one for one in every if one not in low]))
    for posture, runs in postures.items():
        found.append((posture, [one for one in every if one not in runs], runs))
    if other:
        found.append(("another tool", list(slow.values()), list(other.values())))
    return [(name, train, test) for name, train, test in found if train and test]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with davinci-tool and davinci-posture")
    parser.add_argument("--other", type=Path, help="folder of another tool's recordings")
    parser.add_argument("--out", type=Path, default=Path("out/force-comparison"))
    parser.add_argument("--from", dest="signals", nargs="+", choices=SIGNALS, default=SIGNALS)
    parser.add_argument("--only", choices=("splits", "calibration", "bounds"), help="one part")
    given = parser.parse_args()
    tool, postures = tool_runs(given.data / "davinci-tool"), posture_runs(given.data / "davinci-posture")
    other = tool_runs(given.other) if given.other else {}
    given.out.mkdir(parents=True, exist_ok=True)
    if given.only in (None, "bounds"):
        print_bounds([*tool.values(), *(one for runs in postures.values() for one in runs)])
    if given.only in (None, "splits"):
        compare(tool, postures, other, given.signals, given.out)
    if given.only in (None, "calibration"):
        calibrate(tool, postures, given.signals, given.out)


def print_bounds(runs: list[MeasuredRun]) -> None:
    print("run: noise of torque sensors near, far; cycle to cycle near torque, far torque (mN m), far angle (deg)")
    for one in runs:
        found = bounds_of(series_of(one, bench_of([one])))
        torques = (found.near_torque_noise, found.far_torque_noise, found.near_torque_cycles, found.far_torque_cycles)
        print(
            f"{one.name:16s}",
            *(f"{1e3 * value:7.2f}" for value in torques),
            f"{np.degrees(found.far_angle_cycles):.3f}",
        )


def compare(
    tool: dict[str, MeasuredRun],
    postures: dict[str, list[MeasuredRun]],
    other: dict[str, MeasuredRun],
    signals: Sequence[Signal],
    out: Path,
) -> None:
    rows = []
    print(f"Published: {PUBLISHED}.")
    print("| split | from | torque | angle | covered | boosting: torque | angle |\n|---|---|---|---|---|---|---|")
    for signal in signals:
        for split, train, test in splits(tool, postures, other):
            rows.append(held_out(split, train, test, signal))
            print(_line(rows[-1]), flush=True)
        rows.append(at_random(list(tool.values()), signal))
        print(_line(rows[-1]), flush=True)
    (out / "comparison.json").write_text(json.dumps([one._asdict() for one in rows], indent=1), "utf-8")
    draw(rows, out / "comparison.svg")


def _line(row: Row) -> str:
    return (
        f"| {row.split} | {row.signal} | {row.torque:.1f} | {row.angle:.2f} | {100 * row.torque_covered:.0f}, "
        f"{100 * row.angle_covered:.0f} % | {row.peer_torque:.1f} | {row.peer_angle:.2f} |"
    )


def draw(rows: list[Row], path: Path) -> None:
    signals = list(dict.fromkeys(row.signal for row in rows))
    with style.applied():
        figure = Figure(figsize=(4.6 * len(signals), 5.6), layout="constrained")
        axes = figure.subplots(2, len(signals), squeeze=False, sharex="col")
        for column, signal in enumerate(signals):
            shown = [row for row in rows if row.signal == signal]
            place = np.arange(len(shown))
            for axis, ours, theirs, published in (
                (axes[0, column], [r.torque for r in shown], [r.peer_torque for r in shown], 4.42),
                (axes[1, column], [r.angle for r in shown], [r.peer_angle for r in shown], 0.37),
            ):
                axis.bar(place - 0.2, ours, 0.4, color=style.ACCENT, label="tendon model")
                axis.bar(place + 0.2, theirs, 0.4, color=style.REFERENCE, label="gradient boosting")
                axis.axhline(published, color=style.INK, ls=":", label="published, samples at random")
            axes[0, column].set_title(f"from {signal}")
            axes[1, column].set_xticks(place, [row.split for row in shown], rotation=40, ha="right")
        axes[0, 0].set_ylabel("jaw torque, RMSE [mN·m]")
        axes[1, 0].set_ylabel("jaw angle, RMSE [deg]")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
        path.write_text(page.svg_text(figure), "utf-8")


def calibrate(
    tool: dict[str, MeasuredRun], postures: dict[str, list[MeasuredRun]], signals: Sequence[Signal], out: Path
) -> None:
    every = [one for runs in postures.values() for one in runs]
    rows = []
    print("| posture | from | offsets only | one recording | covered | full fit | not determined |")
    print("|---|---|---|---|---|---|---|")
    for signal in signals:
        before, full = fit_force(list(tool.values()), signal), fit_force(every, signal)
        for posture, runs in postures.items():
            row = calibrated(before, full, posture, runs)
            rows.append(row)
            print(
                f"| {posture} | {signal} | {row.carried_torque:.1f}, {row.carried_angle:.2f} | {row.torque:.1f}, "
                f"{row.angle:.2f} | {100 * row.torque_covered:.0f}, {100 * row.angle_covered:.0f} % | "
                f"{row.full_torque:.1f}, {row.full_angle:.2f} | {', '.join(row.undetermined) or 'none'} |",
                flush=True,
            )
    (out / "calibration.json").write_text(json.dumps([one._asdict() for one in rows], indent=1), "utf-8")


if __name__ == "__main__":
    main()
