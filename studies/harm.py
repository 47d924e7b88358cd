"""Whether the motors ever do harm: random work, random faults, and motors that run away.

Peer: the same instrument with its motors standing at home, with the same hand, load and friction. Errors are distances
of the tip from where the handle puts it without a load and without friction. For a fault, the hull of the peer, of this
target, of the run without the fault, and of one whose motors stop when the fault is named, shows what it did itself.
"""

import argparse
import os
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.control import Controller, OperatingState, Request, parameters
from tenodesis.control.controller import fault_names
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.simulate import FaultInjection
from tenodesis.twin import TIME_STEP, Twin

Array = NDArray[np.float64]
Random = np.random.Generator
Faults = tuple[FaultInjection, ...]

RATED = {"scaled-up": 1.485, "real-size": 0.52}  # N; 0.15 N m on the large one, and the same on the small one
EASED, LOADED, FAULT, JUDGED = 1.2, 1.5, 1.8, 2.5  # s
SECONDS, NAMED_WITHIN = 8.0, 3.0  # s
MORE_RMS, MORE_PEAK, MORE_IN_FAULT, MORE_THAN_BOUND = 0.1, 1.0, 2.0, 1.2  # deg, deg, deg, ratio
RELAY = 0.01  # s, that one takes to open
RUN_ON = 1.0  # s, for which a motor that runs away is judged
# Of 800 runs such as those of part 1, before the law had an envelope.
BEFORE = "before the envelope: 133 of 800 runs worse, worst peak +27.8°, tips of 1800 °/s"


class Work(NamedTuple):
    """What an instrument is asked to do, and what its controller assumes of it."""

    seed: tuple[int, int]
    plant: Instrument
    known: Instrument
    handle: Array
    force: Array
    hand: str
    load: str
    words: str


class Comparison(NamedTuple):
    """A run with the motors against one without, deg."""

    work: Work
    rms: float
    rms_off: float
    peak: float
    peak_off: float
    speed: float
    """Largest of the tip, deg/s"""
    speed_off: float
    restrained: float
    """Share of the time"""
    faults: tuple[str, ...]

    @property
    def more_rms(self) -> float:
        return self.rms - self.rms_off

    @property
    def more_peak(self) -> float:
        return self.peak - self.peak_off

    @property
    def worse(self) -> bool:
        return self.more_rms > MORE_RMS or self.more_peak > MORE_PEAK


class Excess(NamedTuple):
    """How much further off target the tip is than with standing motors, and how far outside the hull, deg."""

    off: float
    hull: float


class Outcome(NamedTuple):
    """What a fault did."""

    work: Work
    kind: str
    fault: FaultInjection
    names: tuple[str, ...]
    seconds: float
    """From the fault until it was named; NaN if it was not within :data:`NAMED_WITHIN`"""
    before: Excess
    """Until it was named, or else for :data:`NAMED_WITHIN`"""
    after: Excess
    """From then on"""
    bound: float = np.nan
    """Of a motor that runs away, deg"""

    @property
    def over_bound(self) -> float:
        # What any fault may do is no target of its own.
        return max(self.before.hull, self.after.hull) / max(self.bound, MORE_IN_FAULT / MORE_THAN_BOUND)

    @property
    def words(self) -> str:
        fault, named = self.fault, f"named after {self.seconds:.3f} s" if self.names else "not named"
        size = f"{fault.value:+.3g}" + (f" {fault.rate:+.3g}/s" if fault.rate else "")
        bound = f", bound {self.bound:.2f}°" if self.bound > 0 else ""
        return f"{self.kind}, {fault.point} {fault.mode} {size}, {named}{bound}\n      {self.work.words}"


def eased(time: Array, span: float) -> Array:
    u = np.clip(time / span, 0, 1)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u * u))


def differing(inst: Instrument, friction: float, stiffness: float = 1.0) -> Instrument:
    """Return the instrument with other friction, and with the true stiffness times a factor."""
    true = inst.tendon_stiffness * inst.mismatch.stiffness_ratio
    mismatch = inst.mismatch.model_dump() | {"stiffness_ratio": 1 / stiffness}
    coefficients = {
        f"friction.{name}": getattr(inst.friction, name) * friction
        for name in ("vertex_coefficient", "sheath_coefficient")
    }
    return inst.replace(tendon_stiffness=true * stiffness, mismatch=mismatch, **coefficients)


def make_work(inst: Instrument, seed: int, number: int, trial: bool = False) -> Work:
    """Return random work; trial: of a fault, under the rated load, by a hand without tremor."""
    random = np.random.default_rng([seed, number, trial])
    count = round(SECONDS / TIME_STEP)
    time = np.arange(1, count + 1, dtype=np.float64) * TIME_STEP
    friction, assumed_friction, assumed_stiffness = random.uniform([0.5, 0.7, 0.7], [1.5, 1.3, 1.3])
    plant = differing(inst, friction)
    known = differing(plant, assumed_friction, assumed_stiffness)

    degrees = random.uniform(0, 67 if trial else 80)
    sways = random.random() < (0.5 if trial else 0.75)
    sway, rate, phase = sways * random.uniform(0, 6), random.uniform(0.1, 2), random.uniform(0, 2 * np.pi)
    moves = np.radians(sway) * np.sin(2 * np.pi * rate * time + phase)
    tremor, tones = (not trial and random.random() < 0.5) * random.uniform(0.05, 0.5), random.choice([1, 12])
    for tone, at in random.uniform([6, 0], [12, 2 * np.pi], (tones, 2)):
        moves += np.radians(tremor) / np.sqrt(tones) * np.sin(2 * np.pi * tone * time + at)
    aim = float(tn.statics.handle_angle(inst, np.radians(degrees)))
    handle = np.clip((aim + moves) * eased(time, EASED), -inst.handle_range, inst.handle_range)

    mean, size, beat = random.uniform(-1, 1), random.uniform(0, 0.5) * (random.random() < 0.75), random.uniform(0, 3)
    if trial:
        mean, size = np.sign(mean), 0.0
    scale = RATED[inst.name] / max(1, abs(mean) + size)
    force = scale * (mean + size * np.sin(2 * np.pi * beat * (time - LOADED))) * (time > LOADED)
    hand = "tremor" if tremor else "swaying" if sways else "still"
    load = "constant" if not size else "reversing" if size > abs(mean) else "varying"
    words = (
        f"#{number} {inst.name} {degrees:.0f}°, sway {sway:.1f}° {rate:.1f} Hz, tremor {tremor:.2f}°"
        f"{' noise' if tremor and tones > 1 else ''}, load {scale * mean:+.2f} N + {scale * size:.2f} N {beat:.1f} Hz, "
        f"friction x{friction:.2f} assumed x{assumed_friction:.2f}, stiffness assumed x{assumed_stiffness:.2f}"
    )
    return Work((seed, number), plant, known, handle, force, hand, load, words)


def run_off(work: Work) -> tuple[Run, Array]:
    """Return the run with standing motors, and the target, deg."""
    off = Twin(work.plant, seed=work.seed[1]).run(work.handle, work.force)
    target, stop = tn.statics.output_angle(work.plant, off["handle_angle"], 0.0), work.plant.output_stop
    return off, np.degrees(np.clip(target, -stop, stop))


def run_on(work: Work, faults: Faults = (), pause: float | None = None, relay: float = np.inf) -> Run:
    """Return the run with the law; pause: time from which on the motors stand, s; relay: as the twin takes it, s."""
    request = np.zeros(work.handle.size, int)
    if pause is not None:
        request[round(pause / TIME_STEP)] = Request.PAUSE
    twin, controller = Twin(work.plant, seed=work.seed[1]), Controller(work.known)
    return twin.run(
        work.handle,
        work.force,
        controller=controller,
        request=request,
        fault_injection=faults,
        relay=relay,
    )


def faults_in(run: Run) -> tuple[str, ...]:
    return fault_names(int(np.bitwise_or.reduce(run["faults"].astype(int))))


def errors(tip: Array, off: Run, target: Array) -> tuple[float, float, float, float]:
    """Return the RMS error (deg) of a tip (rad) and that of the run with standing motors, then both peaks."""
    judged = off.time > JUDGED
    both = np.degrees([tip, off["output_angle"]])[:, judged] - target[judged]
    (rms, rms_off), (peak, peak_off) = np.sqrt((both**2).mean(1)).tolist(), np.abs(both).max(1).tolist()
    return rms, rms_off, peak, peak_off


def compare(work: Work) -> Comparison:
    """Compare a run with the motors with one without."""
    off, target = run_off(work)
    on = run_on(work)
    judged = on.time > JUDGED
    speed, speed_off = (float(np.degrees(np.abs(run["output_velocity"][judged]).max())) for run in (on, off))
    restrained = float(np.mean(on["phase"][judged] == 4))
    return Comparison(work, *errors(on["output_angle"], off, target), speed, speed_off, restrained, faults_in(on))


def either(random: Random, low: float, high: float) -> float:
    """Return a size, evenly on a logarithmic scale, of either sign."""
    return float(random.choice([-1, 1]) * np.exp(random.uniform(np.log(low), np.log(high))))


def gain(random: Random, low: float = 0.5, high: float = 2.0) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def injector(point: str, mode: str, value: Any = None, rate: Any = None) -> Callable[[Random], FaultInjection]:
    """Return what draws a fault; a point that ends in a dot is at either tendon."""

    def draw(random: Random) -> FaultInjection:
        side = random.choice(["agonist", "antagonist"])
        where: Any = point + str(side) if point.endswith(".") else point
        how: Any = mode
        return FaultInjection(where, how, value(random) if value else 0.0, rate(random) if rate else 0.0, FAULT)

    return draw


def ticks_lost(random: Random) -> FaultInjection:
    return FaultInjection("tick", "hold", start=FAULT, stop=FAULT + gain(random, 0.005, 0.5))


KINDS: dict[str, Callable[[Random], FaultInjection]] = {
    "cell steps": injector("tension.", "add", lambda r: either(r, 1, 10)),
    "cell drifts": injector("tension.", "add", rate=lambda r: either(r, 0.2, 5)),
    "cell gain": injector("tension.", "scale", gain),
    "cell frozen": injector("tension.", "hold"),
    "cells swapped": injector("tension.", "swap"),
    "handle steps": injector("handle_angle", "add", lambda r: np.radians(either(r, 5, 15))),
    "handle drifts": injector("handle_angle", "add", rate=lambda r: np.radians(either(r, 1, 60))),
    "handle frozen": injector("handle_angle", "hold"),
    "spool encoder frozen": injector("spool_angle.", "hold"),
    "spool encoder reversed": injector("spool_angle.", "scale", lambda r: -1.0),
    "spool encoder loses": injector("spool_angle.", "add", rate=lambda r: either(r, 0.01, 1)),
    "spool encoder gain": injector("spool_angle.", "scale", gain),
    "spool encoders swapped": injector("spool_angle.", "swap"),
    "motors swapped": injector("spool_velocity.", "swap"),
    "motor reversed": injector("spool_velocity.", "scale", lambda r: -1.0),
    "motor dead": injector("spool_velocity.", "set"),
    "drive offset": injector("spool_velocity.", "add", lambda r: either(r, 0.05, 1)),
    "drive at half speed": injector("spool_velocity.", "scale", lambda r: 0.5),
    "drive at double speed": injector("spool_velocity.", "scale", lambda r: 2.0),
    "ticks lost": ticks_lost,
}
RUN_AWAY = injector("spool_velocity.", "set", lambda r: either(r, 0.3, 20))


def judge(work: Work, kind: str, fault: FaultInjection, faulty: Run, lasting: float) -> Outcome:
    """Compare a run with a fault with a run without, and with standing motors.

    lasting: time judged after the fault is named, s.
    """
    off, target = run_off(work)
    healthy = run_on(work)
    found = np.flatnonzero((faulty["operating_state"] == OperatingState.FAULT) & (faulty.time > FAULT))
    named = faulty.time[found[0]] - FAULT if found.size else np.inf
    names = fault_names(int(faulty["faults"][found[0]])) if named <= NAMED_WITHIN else ()
    until = FAULT + min(named, NAMED_WITHIN)
    peers = [off, healthy]
    if names:
        # With the best answer to a fault the motors stand from there on.
        peers.append(run_on(work, pause=until))
    tip, others = np.degrees(faulty["output_angle"]), np.degrees([one["output_angle"] for one in peers])
    hull = np.vstack([target, others])
    outside = np.maximum(tip - hull.max(0), hull.min(0) - tip)

    def excess(during: NDArray[np.bool_]) -> Excess:
        error, peer = np.abs(tip - target)[during].max(), np.abs(others[0] - target)[during].max()
        return Excess(float(error - peer), float(max(outside[during].max(), 0)))

    before = (faulty.time > FAULT) & (faulty.time <= until)
    after = (faulty.time > until) & (faulty.time <= until + lasting)
    return Outcome(work, kind, fault, names, float(named) if names else np.nan, excess(before), excess(after))


def try_fault(work: Work, kind: str) -> Outcome:
    fault = KINDS[kind](np.random.default_rng([*work.seed, 2]))
    return judge(work, kind, fault, run_on(work, (fault,), relay=RELAY), np.inf)


def try_run_away(work: Work, relay: bool) -> Outcome:
    fault = RUN_AWAY(np.random.default_rng([*work.seed, 3]))
    faulty = run_on(work, (fault,), relay=RELAY if relay else np.inf)
    outcome = judge(work, f"with{'' if relay else 'out'} a relay", fault, faulty, RUN_ON)
    return outcome._replace(bound=bound_of(work, fault, faulty if relay else None))


def bound_of(work: Work, fault: FaultInjection, cut: Run | None) -> float:
    """Return how far (deg) physics lets a motor that runs away take the tip, with the best that its partner can do.

    It must be noticed first; then the partner, with the same drive, goes along, late by that time. It must stop where
    the other tendon gets slack, or its own gets to the limit. Where its own is slack, a load takes the tip as far as
    the motor lets out; at the limit, the motor pulls it. The joint's stop ends this.

    cut: the run in which a relay ends it; None: there is no relay.
    """
    own, limits = parameters(work.known).axes[0], parameters(work.known).limits[0]
    common, speed = parameters(work.known).common, abs(fault.value)
    threshold, persistence = limits["motor_not_following"]
    # Unwound, since this has the drive alone.
    alone = Twin(work.known).run(np.zeros(round((RUN_ON + 0.1) / TIME_STEP)), spool_velocity=np.array([-speed, 0.0]))
    path = -alone["spool_angle"][:, 0]
    strayed, kept = np.zeros(path.size), own["watch_window"] / (own["watch_window"] + TIME_STEP)
    for n in range(1, path.size):
        strayed[n] = (strayed[n - 1] + path[n] - path[n - 1]) * kept
    late = int(np.argmax(strayed > threshold)) + round(persistence / TIME_STEP)
    side = ("spool_velocity.agonist", "spool_velocity.antagonist").index(fault.point)
    # Where a motor without supply comes to rest.
    rest = path + np.gradient(path, TIME_STEP) ** 2 / (2 * common["acceleration_limit"])
    last = late + round(RUN_ON / TIME_STEP)
    if cut is not None:
        # The relay opens when the motor is fastest.
        speeds = np.abs(cut.between(FAULT, FAULT + RUN_ON)["spool_velocity"][late:, side])
        last = late + int(np.argmax(speeds))
    end = path[last] if cut is None else rest[last]

    healthy = run_on(work).between(FAULT, FAULT + RUN_ON)
    tension, partner = healthy["tension"][:, side], healthy["tension"][:, 1 - side]
    stiffness = work.plant.tendon_stiffness * work.plant.mismatch.stiffness_ratio * own["spool_radius"]
    beyond = 0.0
    if fault.value > 0:
        # Friction adds to what winding raises.
        free = (common["tension_limit"] - partner.max()) / (stiffness * (1 + own["mean_band"]))
        beyond = max(end - free, 0.0) / 2
    else:
        free = tension.min() / stiffness
        if (tension > partner).any():
            free = partner.min() / stiffness
            beyond = max(end - free, 0.0)
    # The partner's order is a ramp, which its loop follows late.
    behind = late + round(own["drive_time_constant"] / TIME_STEP)
    ahead = (path[behind:] - path[:-behind])[: last + 1].max()
    if cut is not None:
        ahead = max(ahead, rest[last] - rest[max(last - behind, 0)])
    stopping = rest[last] - path[last] + speed * own["drive_time_constant"] if end > free else 0.0
    toward = (1 if side == 0 else -1) * np.sign(fault.value)
    stop = work.plant.output_stop - (toward * healthy["output_angle"]).min()
    moved = max((ahead + stopping) / 2, beyond) * own["spool_radius"] / own["distal_radius"]
    return float(np.degrees(min(moved, stop)))


def report(target: str, done: Sequence[Any], harm: Callable[[Any], float], most: float) -> None:
    """Print whether a target is reached, and the worst runs."""
    beyond = sum(harm(one) > most for one in done)
    print(f"  {target}: {beyond} of {len(done)}   target 0   {'MISSED' if beyond else 'reached'}")
    for one in sorted(done, key=harm, reverse=True)[: min(beyond, 3)]:
        print(f"    {harm(one):+.2f}: {one.words if isinstance(one, Outcome) else one.work.words}")


def grouped(done: Iterable[Any], labels: Callable[[Any], Iterable[str]]) -> dict[str, list[Any]]:
    groups: dict[str, list[Any]] = defaultdict(list)
    for one in done:
        for label in labels(one):
            groups[label].append(one)
    return groups


def report_work(done: list[Comparison]) -> None:
    print(
        "no faults, error of the tip in deg:     mean RMS       median     worst more than off  restrained    tip, °/s"
    )
    print(
        "  hand     load        runs   worse     on    off     on    off      RMS    peak                     on   off"
    )
    in_order = sorted(done, key=lambda one: (one.work.hand, one.work.load))
    groups = grouped(in_order, lambda one: [f"{one.work.hand:9s}{one.work.load}"])
    for label, own in (groups | grouped(done, lambda one: [one.work.plant.name]) | {"all": done}).items():
        values = np.array([one[1:8] for one in own])
        (rms, off), (mid, mid_off) = values[:, :2].mean(0), np.median(values[:, :2], 0)
        more_rms, more_peak = max(one.more_rms for one in own), max(one.more_peak for one in own)
        print(
            f"  {label:18s}{len(own):6d}{sum(one.worse for one in own):8d}{rms:7.2f}{off:7.2f}{mid:7.2f}{mid_off:7.2f}"
            f"{more_rms:+9.2f}{more_peak:+8.2f}{100 * values[:, 6].mean():9.1f} %{values[:, 4].max():10.0f}"
            f"{values[:, 5].max():6.0f}"
        )
    print(f"  {BEFORE}")
    report(f"RMS beyond off by more than {MORE_RMS:g}°", done, lambda one: one.more_rms, MORE_RMS)
    report(f"peak beyond off by more than {MORE_PEAK:g}°", done, lambda one: one.more_peak, MORE_PEAK)
    report("faults raised", done, lambda one: len(one.faults), 0)


COLUMNS = "runs  named  median s  longest  until named: off   hull   then: off   hull"


def columns(own: list[Outcome]) -> str:
    seconds = [one.seconds for one in own if one.names] or [np.nan]
    worst = np.max([(*one.before, *one.after) for one in own], axis=0)
    return (
        f"{len(own):4d}{sum(bool(one.names) for one in own):7d}{np.median(seconds):10.3f}{max(seconds):9.3f}"
        f"{worst[0]:+18.2f}{worst[1]:7.2f}{worst[2]:+12.2f}{worst[3]:7.2f}"
    )


def report_faults(done: list[Outcome]) -> None:
    print(f"one fault each at {FAULT:g} s: the tip in deg beyond motors off, and outside the hull")
    print(f"  {'fault':23s}{COLUMNS}  names")
    for kind, own in grouped(done, lambda one: [one.kind]).items():
        names = Counter(",".join(one.names) for one in own if one.names)
        print(f"  {kind:23s}{columns(own)}  {', '.join(f'{name} {count}' for name, count in names.items())}")
    beyond = f"beyond motors off by more than {MORE_IN_FAULT:g}°"
    report(f"{beyond} until it is named", done, lambda one: one.before.off, MORE_IN_FAULT)
    report(f"{beyond} from then on", done, lambda one: one.after.off, MORE_IN_FAULT)


def report_run_aways(done: list[Outcome]) -> None:
    print(f"a motor that runs away at {FAULT:g} s, and the next second")
    print(f"  {'rad/s':26s}{COLUMNS}  hull over bound: median, worst")
    for kind, own in grouped(done, lambda one: [one.kind]).items():
        for low, high in pairwise((0.3, 1, 3, 10, 21)):
            band = [one for one in own if low <= abs(one.fault.value) < high]
            if band:
                ratios = [one.over_bound for one in band]
                label = f"{low:g} to {min(high, 20):g} {kind}"
                print(f"  {label:26s}{columns(band)}{np.median(ratios):8.2f}{max(ratios):8.2f}")
        report(f"{kind} beyond {MORE_THAN_BOUND:g} of the bound", own, lambda one: one.over_bound, MORE_THAN_BOUND)


def instruments(names: Iterable[str]) -> list[Instrument]:
    return [tn.load(name).axis("yaw") for name in names]


def main() -> None:
    # Faults are results here.
    warnings.simplefilter("ignore", tn.errors.FaultWarning)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--runs", type=int, default=200, help="without faults")
    parser.add_argument("--faults", type=int, default=120, help="runs with one each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--instrument", choices=[*RATED], action="append", help="by default all")
    parser.add_argument("--exact", action="store_true", help="the law knows friction and stiffness as they are")
    parser.add_argument("--assistance", type=float, help="share of the lost angle that the law gives back")
    options = parser.parse_args()
    insts = instruments(options.instrument or RATED)
    tn.set_threads(1)
    begun = time.perf_counter()

    def work(n: int, trial: bool) -> Work:
        drawn = make_work(insts[n % len(insts)], options.seed, n, trial)
        known = drawn.plant if options.exact else drawn.known
        if options.assistance is not None:
            known = known.replace(**{"control.assistance": options.assistance})
        return drawn._replace(known=known)

    kinds = list(KINDS)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        if options.runs:
            report_work(list(pool.map(lambda n: compare(work(n, False)), range(options.runs))))
        # In pairs, so that each kind comes to each instrument.
        pairs = [(n, kinds[n // len(insts) % len(kinds)]) for n in range(options.faults)]
        report_faults(
            sorted(
                pool.map(lambda pair: try_fault(work(pair[0], True), pair[1]), pairs),
                key=lambda one: kinds.index(one.kind),
            )
        )
        cases = [(n, relay) for relay in (False, True) for n in range(options.faults // 2)]
        report_run_aways(list(pool.map(lambda case: try_run_away(work(case[0], True), case[1]), cases)))
    print(f"{time.perf_counter() - begun:.0f} s on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
