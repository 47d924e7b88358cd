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

import functools
import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import law
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
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, Rows

PUBLISHED = "0.37° and 4.42 mN·m, neural networks, samples of all runs at random (O'Neill et al. 2018)"
BLOCK = 0.01  # s, between the samples of the peer
SPEED_TIME = 0.1  # s
SHARE = 0.2  # held out at random
SEED = 0
RANDOM = "samples at random"


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


def judged(results: Iterable[RunResult], before: str = "") -> dict[str, float]:
    """Return RMS errors, mN m and deg, and how often our intervals cover."""
    found = pooled(list(results))
    return {
        f"{before}torque": 1e3 * found.torque_rmse,
        f"{before}angle": math.degrees(found.angle_rmse),
        f"{before}torque_covered": found.torque_covered,
        f"{before}angle_covered": found.angle_covered,
    }


def beside_peer(
    test: Sequence[MeasuredRun], ours: Iterable[RunResult], squares: Sequence[tuple[float, float]]
) -> dict[str, Any]:
    torque, angle = np.sqrt(np.mean(squares, axis=0)).tolist()
    names = " ".join(Path(one.name).stem for one in test)
    return {"held_out": names, **judged(ours), "peer_torque": torque, "peer_angle": angle}


def held_out(train: list[MeasuredRun], test: list[MeasuredRun], signal: Signal) -> dict[str, Any]:
    """Return the errors of ours and of the peer on runs that were held out."""
    model = fit_force(train, signal)
    fitted = [series_of(checked(one, signal), model.bench, interval=BLOCK) for one in train]
    boosted = peer(fitted, signal, [one.fitted for one in fitted])
    series = [series_of(checked(one, signal), model.bench, interval=BLOCK) for one in test]
    squares = [errors(one, *boosted(one), one.counted) for one in series]
    return beside_peer(test, [assess(traces(model, one)) for one in test], squares)


def at_random(runs: list[MeasuredRun], signal: Signal) -> dict[str, Any]:
    """Return the errors on a fifth of the samples of all runs, drawn at random; the rest were fitted."""
    usable = [checked(one, signal) for one in runs]
    bench = bench_of(usable)
    chance = np.random.default_rng(SEED)
    series = [series_of(one, bench, interval=BLOCK) for one in usable]
    out = [one.counted & (chance.random(one.time.size) < SHARE) for one in series]
    keep = [one.fitted & ~left for one, left in zip(series, out, strict=True)]
    model = fit_series([replace(one, fitted=used) for one, used in zip(series, keep, strict=True)], bench, signal)
    boosted = peer(series, signal, keep)
    pairs = list(zip(series, out, strict=True))
    ours = [
        assess(Traces(replace(one, counted=left, fitted=one.fitted & left), model.estimate_series(one)))
        for one, left in pairs
    ]
    return beside_peer(runs, ours, [errors(one, *boosted(one), left) for one, left in pairs])


def calibrated(tool: ForceModel, full: ForceModel, runs: list[MeasuredRun]) -> dict[str, Any]:
    """Return the errors on a posture's other recordings, after one of them, each in turn, recalibrated another model.

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
    found = judged(carried, "carried_") | judged(own) | judged((assess(traces(full, one)) for one in runs), "full_")
    return found | {"undetermined": list(weak[0])}


@functools.cache
def tool_runs(folder: Path) -> dict[str, MeasuredRun]:
    """Return the recordings of a tool by name, XY: X is 0 at 0.1 Hz, Y the load level."""
    return {path.stem: davinci_tool.load(path) for path in sorted(folder.glob("*.TXT"))}


@functools.cache
def posture_runs(folder: Path) -> dict[str, list[MeasuredRun]]:
    """Return the recordings of each pitch."""
    found: dict[str, list[MeasuredRun]] = {}
    for path in sorted(folder.glob("*.TXT")):
        found.setdefault(re.sub(r"_\d+$", "", path.stem), []).append(davinci_posture.load(path))
    return found


def splits(data: Path, other: Path | None) -> dict[str, tuple[list[MeasuredRun], list[MeasuredRun]]]:
    """Return the fitted and the held-out runs of the splits."""
    tool, postures = tool_runs(data / "davinci-tool"), posture_runs(data / "davinci-posture")
    slow = {name: one for name, one in tool.items() if name.startswith("0")}
    even, odd = ([one for name, one in slow.items() if int(name[-1]) % 2 == rest] for rest in (0, 1))
    fast = [one for name, one in tool.items() if not name.startswith("0")]
    found = {"loads": (even, odd), "frequencies": ([*slow.values()], fast), "loads, frequencies": (even, fast)}
    every = [one for runs in postures.values() for one in runs]
    if every:
        low = [one for runs in postures.values() for one in runs[::2]]
        found["loads, three postures"] = low, [one for one in every if one not in low]
    for posture, runs in postures.items():
        found[posture] = [one for one in every if one not in runs], runs
    if other:
        found["another tool"] = [*slow.values()], [*tool_runs(other).values()]
    return {name: (train, test) for name, (train, test) in found.items() if train and test}


def compare(data: str, other: str | None, signal: Signal, split: str) -> dict[str, Any]:
    if split == RANDOM:
        return at_random([*tool_runs(Path(data) / "davinci-tool").values()], signal)
    return held_out(*splits(Path(data), Path(other) if other else None)[split], signal)


@functools.cache
def models(data: Path, signal: Signal) -> tuple[ForceModel, ForceModel]:
    """Return the model of the tool, and that of all postures."""
    every = [one for runs in posture_runs(data / "davinci-posture").values() for one in runs]
    return fit_force([*tool_runs(data / "davinci-tool").values()], signal), fit_force(every, signal)


def calibrate(data: str, signal: Signal, posture: str) -> dict[str, Any]:
    return calibrated(*models(Path(data), signal), posture_runs(Path(data) / "davinci-posture")[posture])


def beside(heading: str, before: str = "") -> list[Column]:
    """Return the columns of errors."""
    return [Column(f"{heading}torque", f"{before}torque", form=".1f"), Column("angle", f"{before}angle")]


COVERED = [Column(f"{what} covered", f"{what}_covered", form=".0%") for what in ("torque", "angle")]
COMPARED = [*beside(""), *COVERED, *beside("boosting: ", "peer_")]
CALIBRATED = [
    *beside("offsets only: ", "carried_"),
    *beside("one recording: "),
    *COVERED,
    *beside("full fit: ", "full_"),
    Column("not determined", "undetermined", lambda values: campaign.names(values) or "none", ""),
]


def print_bounds(data: Path) -> None:
    runs = [*tool_runs(data / "davinci-tool").values()]
    runs += [one for few in posture_runs(data / "davinci-posture").values() for one in few]
    print("run: noise of torque sensors near, far; cycle to cycle near torque, far torque (mN m), far angle (deg)")
    for one in runs:
        found = bounds_of(series_of(one, bench_of([one])))
        torques = (found.near_torque_noise, found.far_torque_noise, found.near_torque_cycles, found.far_torque_cycles)
        print(
            f"{one.name:16s}",
            *(f"{1e3 * value:7.2f}" for value in torques),
            f"{np.degrees(found.far_angle_cycles):.3f}",
        )


def draw(rows: Rows, path: Path) -> None:
    by_signal = rows.by("signal")
    with style.applied():
        figure = Figure(figsize=(4.6 * len(by_signal), 5.6), layout="constrained")
        axes = figure.subplots(2, len(by_signal), squeeze=False, sharex="col")
        for column, (signal, shown) in enumerate(by_signal.items()):
            place = np.arange(len(shown))
            for axis, what, published in ((axes[0, column], "torque", 4.42), (axes[1, column], "angle", 0.37)):
                axis.bar(place - 0.2, shown[what], 0.4, color=style.ACCENT, label="tendon model")
                axis.bar(place + 0.2, shown[f"peer_{what}"], 0.4, color=style.REFERENCE, label="gradient boosting")
                axis.axhline(published, color=style.INK, ls=":", label="published, samples at random")
            axes[0, column].set_title(f"from {signal}")
            axes[1, column].set_xticks(place, shown["split"], rotation=40, ha="right")
        axes[0, 0].set_ylabel("jaw torque, RMSE [mN·m]")
        axes[1, 0].set_ylabel("jaw angle, RMSE [deg]")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
        path.write_text(page.svg_text(figure), "utf-8")


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("data", type=Path, help="folder with davinci-tool and davinci-posture")
    parser.add_argument("--other", type=Path, help="folder of another tool's recordings")
    parser.add_argument("--out", type=Path, default=Path("out/force-comparison"))
    parser.add_argument("--from", dest="signals", nargs="+", choices=SIGNALS, default=SIGNALS)
    parser.add_argument("--only", choices=("splits", "calibration", "bounds"), help="one part")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    data, other = str(given.data), given.other and str(given.other)
    if given.only in (None, "bounds"):
        print_bounds(given.data)
    if given.only in (None, "splits"):
        named = [*splits(given.data, given.other), RANDOM]
        cases = campaign.cases(data=[data], other=[other], signal=given.signals, split=named)
        rows = campaign.run(compare, cases, "splits", results=given.results)
        print(f"Published: {PUBLISHED}. Torque in mN m, angle in deg.")
        print(campaign.table(rows.by("split", "signal"), COMPARED, ("split", "from")))
        (given.out / "comparison.json").write_text(json.dumps(list(rows), indent=1), "utf-8")
        draw(rows, given.out / "comparison.svg")
    if given.only in (None, "calibration"):
        postures = posture_runs(given.data / "davinci-posture")
        cases = campaign.cases(data=[data], signal=given.signals, posture=postures)
        rows = campaign.run(calibrate, cases, "calibration")
        print(campaign.table(rows.by("posture", "signal"), CALIBRATED, ("posture", "from")))
        (given.out / "calibration.json").write_text(json.dumps(list(rows), indent=1), "utf-8")


if __name__ == "__main__":
    main()
