"""What becomes of the hand's tremor at the tip, and of what the hand means to do.

Peers: the same instrument with motors that stand at home, and the same without friction, by the same hand and load. The
swing is that of the output angle above 4 Hz, peak to peak. Errors are distances of the tip from where the handle would
put it without tremor, load and friction.

Tremor is a sine, or noise as wide as physiological tremor, whose spectrum has its peak between 6 and 12 Hz (Stiles,
Randall, J. Appl. Physiol. 23, 1967; Elble, Koller, Tremor, 1990) and is that of a mechanical resonance which irregular
muscle force excites (Lakie et al., J. Physiol. 593, 2015).
"""

import argparse
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np
from harm import EASED, LOADED, RATED, differing, eased, instruments
from numpy.typing import NDArray
from scipy import linalg, signal

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.control.controller import fault_names
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.twin import TIME_STEP, Twin

Array = NDArray[np.float64]

FREQUENCIES = (6.0, 8.0, 10.0, 12.0, None)  # Hz; None: noise
AMPLITUDES = (0.05, 0.1, 0.3, 1.0)  # deg, of the handle
ANGLES = (0.0, 33.0, 67.0)  # deg, of the tip
LOADS = (0.0, 1.0)  # of the rated load
SECONDS, JUDGED, BAND = 8.0, 4.0, 4.0  # s, s, Hz
RESONANCE, DAMPING = 8.0, 0.2  # Hz, 1; its spectrum is above half its peak from 5.8 to 9.2 Hz
MORE = 0.2  # deg
INTENT, INTENT_RATE, SMALL, TREMOR = 3.0, 2.0, 0.2, 8.0  # deg, Hz, deg, Hz
SEED = 1


class Hand(NamedTuple):
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


class Tremor(NamedTuple):
    """What becomes of a tremor at the tip, deg; with the law, with motors off, without friction."""

    hand: Hand
    swing: float
    swing_off: float
    swing_free: float
    error: float
    """Mean"""
    error_off: float
    torque: float
    """Largest change of the handle's torque by the motors, N m"""
    torque_off: float
    """Largest of the handle's torque, N m"""
    moving: float
    """Share of the time in which the motors turn"""
    faults: tuple[str, ...]

    @property
    def more(self) -> float:
        return self.swing - self.swing_off


class Intent(NamedTuple):
    """RMS distance of the tip from what the hand means, deg."""

    hand: Hand
    on: float
    on_still: float
    """Without tremor"""
    off: float
    off_still: float


def clock() -> Array:
    return np.arange(1, round(SECONDS / TIME_STEP) + 1, dtype=np.float64) * TIME_STEP


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


def motion(inst: Instrument, hand: Hand) -> tuple[Array, Array, Array]:
    """Return the handle angle without and with tremor, rad, and the force, N."""
    time = clock()
    aim = float(tn.statics.handle_angle(inst, np.radians(hand.angle)))
    sways = np.radians(hand.sway) * np.sin(2 * np.pi * INTENT_RATE * time)
    intent = np.asarray((aim + sways) * eased(time, EASED))
    shaken = intent + np.radians(hand.amplitude) * tremor(hand.frequency, time) * eased(time, EASED)
    return intent, shaken, hand.load * RATED[inst.name] * eased(np.maximum(time - LOADED, 0), 0.2)


def deviation(inst: Instrument, run: Run, intent: Array) -> Array:
    """Return how far the tip is from what the hand means, deg."""
    target = np.clip(tn.statics.output_angle(inst, intent, 0.0), -inst.output_stop, inst.output_stop)
    return np.asarray(np.degrees(run["output_angle"] - target))


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


def shake(inst: Instrument, hand: Hand) -> Tremor:
    """Run a trembling hand with the law and with its peers."""
    intent, handle, force = motion(inst, hand)
    on, off = run_law(inst, handle, force), run_off(inst, handle, force)
    free = run_off(differing(inst, 0), handle, force)
    error, error_off = (float(judged(deviation(inst, run, intent)).mean()) for run in (on, off))
    change = judged(on["handle_torque"] - off["handle_torque"])
    return Tremor(
        hand,
        swing(on),
        swing(off),
        swing(free),
        error,
        error_off,
        float(np.abs(change).max()),
        float(np.abs(judged(off["handle_torque"])).max()),
        float(np.mean(judged(on["phase"]) != 0)),
        fault_names(int(np.bitwise_or.reduce(on["faults"].astype(int)))),
    )


def follow(inst: Instrument, hand: Hand, seed: int = SEED) -> Intent:
    """Run a hand that sways on purpose, with and without tremor."""

    def distance(run: Callable[[Instrument, Array, Array, int], Run], amplitude: float) -> float:
        intent, handle, force = motion(inst, hand._replace(amplitude=amplitude))
        return float(np.sqrt(np.mean(judged(deviation(inst, run(inst, handle, force, seed), intent)) ** 2)))

    size = hand.amplitude
    return Intent(hand, distance(run_law, size), distance(run_law, 0), distance(run_off, size), distance(run_off, 0))


def hands() -> list[Hand]:
    rows = product(ANGLES, LOADS, AMPLITUDES, FREQUENCIES)
    return [Hand(frequency, amplitude, angle, load) for angle, load, amplitude, frequency in rows]


def swaying_hands() -> list[Hand]:
    return [Hand(TREMOR, SMALL, angle, load, INTENT) for angle, load in product(ANGLES, LOADS)]


def report_tremor(name: str, done: Sequence[Tremor]) -> None:
    columns = "".join(f"{'noise' if one is None else f'{one:g} Hz':>18s}" for one in FREQUENCIES)
    print(f"{name}: swing of the tip in deg, with the law / motors off / without friction")
    print(
        f"  {'at':>4s}{'load':>6s}{'tremor':>8s}{columns}{'mean error on, off':>20s}{'torque':>13s}"
        f"{'motors':>8s}  faults"
    )
    width = len(FREQUENCIES)
    for row in (done[n : n + width] for n in range(0, len(done), width)):
        hand = row[0].hand
        cells = "".join(f"{f'{one.swing:.2f}/{one.swing_off:.2f}/{one.swing_free:.2f}':>18s}" for one in row)
        error, error_off = (max(values, key=abs) for values in ([o.error for o in row], [o.error_off for o in row]))
        torque, torque_off = max(o.torque for o in row), max(o.torque_off for o in row)
        faults = dict.fromkeys(name for one in row for name in one.faults)
        print(
            f"  {hand.angle:3.0f}°{'rated' if hand.load else 'none':>6s}{hand.amplitude:7.2f}°{cells}"
            f"{error:+13.2f}{error_off:+7.2f}{1e3 * torque:6.0f}/{1e3 * torque_off:<6.0f}"
            f"{100 * max(o.moving for o in row):5.0f} %  {', '.join(faults)}"
        )
    print("  worst of a row: mean error; handle torque by the motors / with motors off, mN m; motors turn, of the time")


def report_summary(name: str, done: Sequence[Tremor]) -> None:
    worst = max(done, key=lambda one: one.more)
    hand = worst.hand
    what = "noise" if hand.frequency is None else f"{hand.frequency:g} Hz"
    moved = [one.swing / one.swing_off for one in done if one.swing_off > MORE]
    held = [one.swing / one.swing_free for one in done if one.swing_off <= MORE]
    beyond = sum(one.more > MORE for one in done)
    print(
        f"{name}: {beyond} of {len(done)} beyond motors off + {MORE:g}°, worst {worst.more:+.2f}° "
        f"({what}, {hand.amplitude:g}° at {hand.angle:g}°, load {hand.load:g}); median of the swing "
        f"{np.median(moved):.2f} of motors off in the {len(moved)} cells where that moves the tip, "
        f"{np.median(held):.2f} of no friction in the {len(held)} where friction holds it; "
        f"{sum(bool(one.faults) for one in done)} with faults"
    )


def report_prediction(inst: Instrument, done: Sequence[Tremor]) -> None:
    """Print what is left of an irregular tremor at a straight and free tip, and what the best predictor would leave."""
    free = [one for one in done if one.hand.frequency is None and not (one.hand.angle or one.hand.load)]
    for words, shares in (
        ("the law", [one.swing / one.swing_free for one in free]),
        ("the best linear predictor", [unpredictable(inst, one.hand.amplitude) for one in free]),
    ):
        print(
            f"  noise at 0°, no load: {words} leaves of the swing without friction", *(f"{one:.2f}" for one in shares)
        )


def report_intent(name: str, done: Sequence[Intent]) -> None:
    print(
        f"{name}: {INTENT:g}° at {INTENT_RATE:g} Hz at the handle, meant; RMS error of the tip in deg, with tremor of "
        f"{SMALL:g}° at {TREMOR:g} Hz / without"
    )
    for one in done:
        at = f"{one.hand.angle:.0f}°, load {one.hand.load:g}"
        print(f"  {at:14s} law {one.on:5.2f} /{one.on_still:5.2f}   motors off {one.off:5.2f} /{one.off_still:5.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--instrument", choices=[*RATED], action="append", help="by default all")
    options = parser.parse_args()
    names = options.instrument or list(RATED)
    tn.set_threads(1)
    begun = time.perf_counter()
    done = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for inst in instruments(names):
            own = done[inst.name] = list(pool.map(lambda hand, inst=inst: shake(inst, hand), hands()))
            report_tremor(inst.name, own)
            report_prediction(inst, own)
            report_intent(inst.name, list(pool.map(lambda hand, inst=inst: follow(inst, hand), swaying_hands())))
    for name, own in done.items():
        report_summary(name, own)
    print(f"{time.perf_counter() - begun:.0f} s on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
