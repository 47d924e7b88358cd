"""What becomes of the hand's tremor at the tip, and of what the hand means to do.

Peers: the same instrument with motors that stand at home, and the same without friction, by the same hand and load. The
swing is that of the output angle above 4 Hz, peak to peak. Errors are distances of the tip from where the handle would
put it without tremor, load and friction.

Tremor is a sine, or noise as wide as physiological tremor, whose spectrum has its peak between 6 and 12 Hz (Stiles,
Randall, J. Appl. Physiol. 23, 1967; Elble, Koller, Tremor, 1990) and is that of a mechanical resonance which irregular
muscle force excites (Lakie et al., J. Physiol. 593, 2015).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import figures
import law
import numpy as np
from scipy import linalg, signal

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, Rows
from tenodesis.twin import TIME_STEP, Twin

Array = law.Array

FREQUENCIES = (6.0, 8.0, 10.0, 12.0, None)  # Hz; None: noise
AMPLITUDES = (0.05, 0.1, 0.3, 1.0)  # deg, of the handle
ANGLES = (0.0, 33.0, 67.0)  # deg, of the tip
LOADS = (0.0, 1.0)  # of the rated load
EASED, LOADED = 1.2, 1.5  # s
SECONDS, JUDGED, BAND = 8.0, 4.0, 4.0  # s, s, Hz
RESONANCE, DAMPING = 8.0, 0.2  # Hz, 1; its spectrum is above half its peak from 5.8 to 9.2 Hz
MORE = 0.2  # deg
INTENT, INTENT_RATE, SMALL, TREMOR = 3.0, 2.0, 0.2, 8.0  # deg, Hz, deg, Hz
SEED = 1


class HandMotion(NamedTuple):
    """What a hand does at the handle, and the load on the tip."""

    frequency: float | None = TREMOR
    """Of its tremor, Hz; None: noise"""
    amplitude: float = 0.0
    """Of its tremor, deg; noise has the same RMS"""
    angle: float = 0.0
    """Of the tip, deg"""
    load: float = 0.0
    """Of the rated load"""
    sway: float = 0.0
    """Amplitude of what it means to do, at :data:`INTENT_RATE`, deg"""


def clock() -> Array:
    return law.clock(SECONDS)


def tremor(frequency: float | None, time: Array) -> Array:
    """Return a tremor of amplitude 1, or noise of the same RMS."""
    if frequency is not None:
        return np.asarray(np.sin(2 * np.pi * frequency * time))
    pulsation = 2 * np.pi * RESONANCE
    denominator = np.array([1, 2 * DAMPING * pulsation, pulsation**2])
    resonance = signal.cont2discrete((np.array([pulsation**2]), denominator), TIME_STEP)
    white = np.random.default_rng(SEED).normal(size=time.size)
    noise = signal.lfilter(resonance[0].ravel(), resonance[1], white)
    return np.asarray(noise / noise.std() / np.sqrt(2))


def unpredictable(inst: Instrument, amplitude: float) -> float:
    """Return the share of an irregular tremor's swing that the best linear predictor leaves.

    It knows the tremor's spectrum and reads the handle's encoder; motors follow after the time constant of their drives
    (Kalman, J. Basic Eng. 82, 1960).
    """
    time, pulsation = clock(), 2 * np.pi * RESONANCE
    step = np.degrees(inst.sensors.encoder_range) / 2**inst.sensors.encoder_bits
    ahead = round(inst.drives.time_constant / TIME_STEP)
    onward = linalg.expm(np.array([[0, 1], [-(pulsation**2), -2 * DAMPING * pulsation]]) * TIME_STEP)
    usual = np.diag([1, pulsation**2]) * amplitude**2 / 2
    unsure = linalg.solve_discrete_are(
        onward.T, np.array([[1.0], [0.0]]), usual - onward @ usual @ onward.T, np.array([[step**2 / 12]])
    )
    gain = unsure[:, 0] / (unsure[0, 0] + step**2 / 12)
    shaken = amplitude * tremor(None, time)
    state, later = np.zeros(2), np.linalg.matrix_power(onward, ahead)[0]
    left = shaken.copy()
    for n, reading in enumerate(np.round(shaken / step) * step):
        state = onward @ state
        state = state + gain * (reading - state[0])
        if n + ahead < left.size:
            left[n + ahead] -= later @ state
    return float(np.ptp(judged(fast(left))) / np.ptp(judged(fast(shaken))))


def motion(inst: Instrument, hand: HandMotion) -> tuple[Array, Array, Array]:
    """Return the handle angle without and with tremor, rad, and the force, N."""
    time = clock()
    aim = float(tn.statics.handle_angle(inst, np.radians(hand.angle)))
    sways = np.radians(hand.sway) * np.sin(2 * np.pi * INTENT_RATE * time)
    intent = np.asarray((aim + sways) * law.eased(time, EASED))
    shaken = intent + np.radians(hand.amplitude) * tremor(hand.frequency, time) * law.eased(time, EASED)
    return intent, shaken, hand.load * law.RATED[inst.name] * law.eased(np.maximum(time - LOADED, 0), 0.2)


def deviation(inst: Instrument, run: Run, intent: Array) -> Array:
    """Return how far the tip is from what the hand means, deg."""
    return np.asarray(np.degrees(run["output_angle"] - law.target(inst, intent)))


def judged(values: Array) -> Array:
    return values[clock() > SECONDS - JUDGED]


def fast(values: Array) -> Array:
    """Return what is faster than :data:`BAND`, without delay."""
    return np.asarray(signal.sosfiltfilt(signal.butter(4, BAND, "high", fs=1 / TIME_STEP, output="sos"), values))


def swing(run: Run) -> float:
    """Return the swing of the tip, deg."""
    return float(np.ptp(judged(fast(np.degrees(run["output_angle"])))))


def run_law(inst: Instrument, handle: Array, force: Array, seed: int = SEED) -> Run:
    return Twin(inst, seed=seed).run(handle, force, controller=Controller(inst))


def run_off(inst: Instrument, handle: Array, force: Array, seed: int = SEED) -> Run:
    return Twin(inst, seed=seed).run(handle, force)


def shake(inst: Instrument, hand: HandMotion) -> dict[str, Any]:
    """Run a trembling hand with the law and with its peers: swings and mean errors, deg, the handle's torque, N m."""
    intent, handle, force = motion(inst, hand)
    on, off = run_law(inst, handle, force), run_off(inst, handle, force)
    free = run_off(law.differing(inst, 0), handle, force)
    swings = {f"swing{end}": swing(run) for end, run in (("", on), ("_off", off), ("_free", free))}
    what = "noise" if hand.frequency is None else f"{hand.frequency:g} Hz"
    return swings | {
        "more": swings["swing"] - swings["swing_off"],
        "error": judged(deviation(inst, on, intent)).mean(),
        "error_off": judged(deviation(inst, off, intent)).mean(),
        "torque": campaign.farthest(judged(on["handle_torque"] - off["handle_torque"])),
        "torque_off": campaign.farthest(judged(off["handle_torque"])),
        "moving": np.mean(judged(on["phase"]) != 0),
        "faults": law.faults(on),
        "words": f"{inst.name}, {what}, {hand.amplitude:g}° at {hand.angle:g}°, load {hand.load:g}",
    }


def follow(inst: Instrument, hand: HandMotion, seed: int = SEED) -> dict[str, float]:
    """Run a hand that sways on purpose, with tremor and without (still): RMS distance from what it means, deg."""
    found = {}
    for name, run in (("on", run_law), ("off", run_off)):
        for end, amplitude in (("", hand.amplitude), ("_still", 0.0)):
            intent, handle, force = motion(inst, hand._replace(amplitude=amplitude))
            found[name + end] = campaign.rms(judged(deviation(inst, run(inst, handle, force, seed), intent)))
    return found


def trembling(instrument: str, **hand: Any) -> dict[str, Any]:
    return shake(law.instrument(instrument), HandMotion(**hand))


def swaying(instrument: str, **hand: Any) -> dict[str, Any]:
    return follow(law.instrument(instrument), HandMotion(TREMOR, SMALL, sway=INTENT, **hand))


def of_frequency(frequency: float | None) -> Column:
    """Return the column of a frequency: the swings with the law, with motors off, without friction."""

    def cell(rows: Rows) -> str:
        (row,) = rows.where(frequency=frequency)
        return f"{row['swing']:.2f}/{row['swing_off']:.2f}/{row['swing_free']:.2f}"

    return Column("noise" if frequency is None else f"{frequency:g} Hz", cell)


def largest(values: list[float]) -> float:
    return max(values, key=abs)


SHAKEN = [
    *map(of_frequency, FREQUENCIES),
    Column("mean error on", "error", largest, "+.2f"),
    Column("off", "error_off", largest, "+.2f"),
    Column("torque, mN m", lambda rows: f"{1e3 * rows['torque'].max():.0f}/{1e3 * rows['torque_off'].max():.0f}"),
    Column("motors turn", "moving", np.max, ".0%"),
    Column("faults", "faults", campaign.names, ""),
]
FOLLOWED = [Column(name.replace("_", " "), name) for name in ("on", "on_still", "off", "off_still")]


def ratios(over: str, *, moved: bool) -> Callable[[Rows], float]:
    """Return the median of the swing over another, where motors off move the tip, or where friction holds it."""

    def ratio(rows: Rows) -> float:
        chosen = (rows["swing_off"] > MORE) == moved
        return float(np.median((rows["swing"] / rows[over])[chosen]))

    return ratio


SUMMARY = [
    Column("cells, ", len, form="d"),
    Column("beyond motors off, ", lambda rows: (rows["more"] > MORE).sum(), form="d"),
    Column("worst excess", "more", np.max),
    Column("swing over motors off where the tip moves, ", ratios("swing_off", moved=True)),
    Column("swing over no friction where it is held, ", ratios("swing_free", moved=False)),
    Column("largest torque, N m", "torque", np.max),
]


def report_prediction(inst: Instrument, rows: Rows) -> None:
    """Print what is left of an irregular tremor at a straight and free tip, and what the best predictor would leave."""
    free = rows.where(frequency=None, angle=0.0, load=0.0)
    left = {
        "the law": free["swing"] / free["swing_free"],
        "the best linear predictor": [unpredictable(inst, row["amplitude"]) for row in free],
    }
    for words, shares in left.items():
        print(f"  noise at 0°, no load: {words} leaves of the swing", *(f"{one:.2f}" for one in shares))


def main() -> None:
    options = law.arguments(__doc__, law.RATED).parse_args()
    names = options.instrument or [*law.RATED]
    hands = {"instrument": names, "angle": ANGLES, "load": LOADS}
    cases = campaign.cases(**hands, amplitude=AMPLITUDES, frequency=FREQUENCIES)
    shaken = campaign.run(trembling, cases, "tremor", results=options.results)
    swayed = campaign.run(swaying, campaign.cases(**hands), "intent")
    for name in names:
        rows = shaken.where(instrument=name)
        print(f"{name}: swing of the tip in deg, with the law / motors off / without friction; worst of a row beside")
        print(campaign.table(rows.by("angle", "load", "amplitude"), SHAKEN, ("at, deg", "load", "tremor, deg")))
        report_prediction(law.instrument(name), rows)
        print(
            f"{name}: {INTENT:g}° at {INTENT_RATE:g} Hz meant at the handle; RMS error of the tip in deg, with tremor"
        )
        print(f"  of {SMALL:g}° at {TREMOR:g} Hz and without, still")
        groups = swayed.where(instrument=name).by("angle", "load")
        law.show(options, f"tremor_meant_{figures.slug(name)}", groups, FOLLOWED, ("at", "load"))
    law.show(options, "tremor", shaken.by("instrument"), SUMMARY, f"swing beyond motors off by {MORE:g}°")
    for name in names:
        print(campaign.verdict(f"{name}: beyond motors off + {MORE:g}°", shaken.where(instrument=name), "more", MORE))


if __name__ == "__main__":
    main()
