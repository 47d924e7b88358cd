"""How hard the tip presses on tissue that is in its way, with the motors off and with the controller.

Peer: the same instrument with its motors standing at home, with the same hand, load and tissue, which is a spring and a
damper at the tip (:class:`tenodesis.twin.Contact`).
"""

import argparse
import os
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.control.controller import fault_names
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.twin import TIME_STEP, Contact, Twin

Array = NDArray[np.float64]

RATED = {"scaled-up": 1.485, "real-size": 0.52}  # N; 0.15 N m on the large one, and the same on the small one
STIFFNESSES = (0.1, 0.3, 1.0, 3.0, 10.0)  # N/mm
RELAXATION = 5e-3  # s, damping over stiffness
EASED, LOADED, SECONDS = 1.2, 1.5, 6.0  # s
END = 1.0  # s, in which the tip is judged at rest or not
SWINGING, NO_FORCE = 0.2, 0.01  # deg peak to peak, N


class State(NamedTuple):
    """Where the hand wants the tip, and where tissue is in its way, deg."""

    hand: float
    place: float
    loaded: bool = False
    """By the rated force, which pushes the tip into tissue in extension"""

    @property
    def words(self) -> str:
        return f"{self.hand:.0f}° to {self.place:.0f}°{' loaded' if self.loaded else ''}"


STATES = (State(33, 28), State(33, 20), State(67, 60), State(67, 40), State(0, -5, loaded=True))


class Pressed(NamedTuple):
    """A run into tissue."""

    peak: float
    """Largest contact force, N"""
    final: float
    """Mean over the end, N"""
    swing: float
    """Of the tip at the end, deg peak to peak"""
    faults: tuple[str, ...]


class Row(NamedTuple):
    """A run with standing motors, and one with the controller."""

    inst: str
    state: State
    stiffness: float
    off: Pressed
    on: Pressed

    @property
    def peak_ratio(self) -> float:
        return ratio(self.on.peak, self.off.peak)

    @property
    def final_ratio(self) -> float:
        return ratio(self.on.final, self.off.final)

    @property
    def words(self) -> str:
        return f"{self.inst} {self.state.words}, {self.stiffness:g} N/mm"


def ratio(on: float, off: float) -> float:
    """Return a force over that with standing motors; NaN where neither presses."""
    return on / off if off > NO_FORCE else np.inf if on > NO_FORCE else np.nan


def eased(time: Array, span: float) -> Array:
    u = np.clip(time / span, 0, 1)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u * u))


def judged(run: Run) -> Pressed:
    """Return how a run presses."""
    force, end = np.abs(run["contact_force"]), run.time > SECONDS - END
    swing = float(np.degrees(np.ptp(run["output_angle"][end])))
    faults = () if run.faults is None else fault_names(int(np.bitwise_or.reduce(run["faults"].astype(int))))
    return Pressed(float(force.max()), float(force[end].mean()), swing, faults)


def press(inst: Instrument, state: State, stiffness: float) -> Row:
    """Run into tissue of some stiffness, N/mm."""
    clock = np.arange(1, round(SECONDS / TIME_STEP) + 1, dtype=np.float64) * TIME_STEP
    handle = float(tn.statics.handle_angle(inst, np.radians(state.hand))) * eased(clock, EASED)
    force = RATED[inst.name] * state.loaded * eased(clock - EASED, LOADED - EASED)
    side = "extension" if state.place < 0 else "flexion"
    contact = Contact(np.radians(state.place), 1e3 * stiffness, 1e3 * stiffness * RELAXATION, side)  # type: ignore[arg-type]
    off = Twin(inst).run(handle, force, contact=contact)
    on = Twin(inst).run(handle, force, contact=contact, controller=Controller(inst))
    return Row(inst.name, state, stiffness, judged(off), judged(on))


def report(rows: Sequence[Row]) -> None:
    print(f"contact force, N; the tip in the last {END:g} s, deg peak to peak")
    print(
        f"  {'instrument':11s}{'hand to tissue':17s}{'N/mm':>6s}   peak off     on  ratio  final off     on  ratio"
        "  swing off     on  faults"
    )
    for row in rows:
        off, on = row.off, row.on
        print(
            f"  {row.inst:11s}{row.state.words:17s}{row.stiffness:6g}"
            f"{off.peak:11.2f}{on.peak:7.2f}{row.peak_ratio:7.2f}{off.final:11.2f}{on.final:7.2f}{row.final_ratio:7.2f}"
            f"{off.swing:11.2f}{on.swing:7.2f}  {', '.join(on.faults) or '-'}"
        )
    for name in dict.fromkeys(row.inst for row in rows):
        own = [row for row in rows if row.inst == name]
        peaks, finals = (np.array([getattr(row, key) for row in own]) for key in ("peak_ratio", "final_ratio"))
        largest = max(row.on.peak for row in own)
        print(
            f"  {name}: peak {np.nanmean(peaks):.2f} × off on average, {np.nanmax(peaks):.2f} × at worst; final "
            f"{np.nanmean(finals):.2f} ×, {np.nanmax(finals):.2f} ×; largest force {largest:.2f} N"
        )
    for target, found in (
        (f"tips that swing by more than {SWINGING:g}°", [row for row in rows if row.on.swing > SWINGING]),
        ("and with motors off", [row for row in rows if row.off.swing > SWINGING]),
        ("faults", [row for row in rows if row.on.faults]),
    ):
        print(f"  {target}: {len(found)} of {len(rows)}   target 0   {'MISSED' if found else 'reached'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--instrument", choices=[*RATED], action="append", help="by default all")
    options = parser.parse_args()
    begun = time.perf_counter()
    cases = [
        (tn.load(name).axis("yaw"), state, stiffness)
        for name in options.instrument or RATED
        for state in STATES
        for stiffness in STIFFNESSES
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        report(list(pool.map(lambda case: press(*case), cases)))
    print(f"{time.perf_counter() - begun:.0f} s on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
