"""Whether the motors ever do harm: random work, random faults, and motors that run away.

Peer: the same instrument with its motors standing at home, with the same hand, load and friction. Errors are distances
of the tip from where the handle puts it without a load and without friction. No law is never worse than that: a stroke
is wrong by itself once the load has gone that it was wound for. So harmful is what is worse, too, than motors on the
same drives that know the tip without error (ideal). Work that changes has steps, threads that snap, tissue that comes
and goes, loads that end, and stops. For a fault, the hull of the peer, of this
target, of the run without the fault, and of one whose motors stop when the fault is named, shows what it did itself.
"""

from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any, NamedTuple

import figures
import law
import numpy as np
from law import RATED, differing, eased

import tenodesis as tn
from tenodesis.control import TUNING, Controller, OperatingState, Request, parameters
from tenodesis.control.controller import fault_names
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.simulate import FaultInjection, campaign
from tenodesis.simulate.campaign import Column, Rows
from tenodesis.twin import TIME_STEP, Twin

Array = law.Array
Random = np.random.Generator
Faults = tuple[FaultInjection, ...]
Metrics = dict[str, Any]

EASED, LOADED, FAULT, JUDGED = 1.2, 1.5, 1.8, 2.5  # s
SECONDS, NAMED_WITHIN = 8.0, 3.0  # s
MORE_RMS, MORE_PEAK, MORE_IN_FAULT, MORE_THAN_BOUND = 0.1, 1.0, 2.0, 1.2  # deg, deg, deg, ratio
RELAY = 0.01  # s, that one takes to open
CHANGES = ("steps", "snaps", "tissue", "ends", "stops")
HOMED = 0.05
"""Deviation of a stiffness that homing has measured, as a share"""
RUN_ON = 1.0  # s, for which a motor that runs away is judged


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
    tissue: Array | None = None
    """As :class:`law.MovingTissue` takes it"""
    stop: float = np.inf
    """When the motors are stopped, s"""


def make_work(inst: Instrument, seed: int, number: int, trial: bool = False) -> Work:
    """Return random work; trial: of a fault, under the rated load, by a hand without tremor."""
    random = np.random.default_rng([seed, number, trial])
    time = law.clock(SECONDS)
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


def changed(work: Work) -> Work:
    """Return work with a load or tissue that changes in another way, or that is stopped."""
    random = np.random.default_rng([*work.seed, 4])
    time, rated, kind = law.clock(SECONDS), RATED[work.plant.name], str(random.choice(CHANGES))
    at, period, size = random.uniform(JUDGED, SECONDS - 2), float(np.exp(random.uniform(*np.log([0.4, 4])))), rated
    size *= float(random.choice([-1, 1]) * random.uniform(0.25, 0.9))
    since = time - LOADED
    force, tissue, stop = work.force, work.tissue, np.inf
    if kind == "steps":
        force = size * np.sign(np.sin(2 * np.pi * since / period)) * (since > 0)
    elif kind == "snaps":
        force = size * (since / period % 1) * (since > 0)
    elif kind == "ends":
        force = np.where(time < at, size * (since > 0), 0.0)
    elif kind == "stops":
        stop = at
        force = np.where(time < at + random.uniform(0.2, 1.5), size * (since > 0), 0.0)
    else:
        side, stiffness, beat = np.sign(size), np.exp(random.uniform(*np.log([100, 1e4]))), since / period % 1
        way = np.where(beat < 0.5, eased(beat, 0.1), 1 - eased(beat - 0.5, 0.1)) * (since > 0)
        place = law.target(work.plant, work.handle) + side * np.radians(20 - random.uniform(20, 30) * way)
        tissue = np.stack([place, np.full(time.size, side * stiffness), np.full(time.size, 5e-3 * stiffness)], 1)
    words = f"{work.words}, then {kind}, {size:+.2f} N {period:.2f} s {at:.2f} s"
    return work._replace(force=force, load=kind, words=words, tissue=tissue, stop=stop)


def twin_of(work: Work) -> Twin:
    seed = work.seed[1]
    return Twin(work.plant, seed=seed) if work.tissue is None else law.MovingTissue(work.plant, work.tissue, seed)


def run_off(work: Work) -> tuple[Run, Array]:
    """Return the run with standing motors, and the target, deg."""
    off = twin_of(work).run(work.handle, work.force)
    return off, np.degrees(law.target(work.plant, off["handle_angle"]))


def run_on(work: Work, faults: Faults = (), pause: float | None = None, relay: float = np.inf) -> Run:
    """Return the run with the law; pause: time from which on the motors stand, s; relay: as the twin takes it, s."""
    request = np.zeros(work.handle.size, int)
    known = work.known
    if pause is not None:
        request[round(pause / TIME_STEP)] = Request.PAUSE
        known = known.replace(**{"control.stop": "hold"})
    if work.stop < SECONDS:
        request[round(work.stop / TIME_STEP)] = Request.DISABLE
    twin, controller = twin_of(work), Controller(known)
    return twin.run(
        work.handle, work.force, controller=controller, request=request, fault_injection=faults, relay=relay
    )


def errors(tip: Array, off: Run, target: Array) -> Metrics:
    """Return the error of a tip (rad) and that of the run with standing motors, RMS and peak, deg."""
    judged = off.time > JUDGED
    both = np.degrees([tip, off["output_angle"]])[:, judged] - target[judged]
    (rms, rms_off), (peak, peak_off) = campaign.rms(both, axis=1).tolist(), np.abs(both).max(1).tolist()
    more = {"more_rms": rms - rms_off, "more_peak": peak - peak_off}
    worse = more["more_rms"] > MORE_RMS or more["more_peak"] > MORE_PEAK
    return {"rms": rms, "rms_off": rms_off, "peak": peak, "peak_off": peak_off, **more, "worse": worse}


def compare(work: Work) -> Metrics:
    """Compare a run with the motors with one without: errors, deg, speeds of the tip, deg/s."""
    off, target = run_off(work)
    on = run_on(work)
    judged = on.time > JUDGED
    speed, speed_off = (float(np.degrees(np.abs(run["output_velocity"][judged]).max())) for run in (on, off))
    aim, seed = np.radians(target), work.seed[1]
    tip = law.tip_sensor(work.plant, seed, work.handle, work.force, aim, tissue=work.tissue, stop=work.stop)
    found, ideal = errors(on["output_angle"], off, target), errors(tip, off, target)
    beyond_rms = min(found["more_rms"], found["rms"] - ideal["rms"])
    beyond_peak = min(found["more_peak"], found["peak"] - ideal["peak"])
    return found | {
        "rms_ideal": ideal["rms"],
        "worse_ideal": ideal["worse"],
        "beyond_rms": beyond_rms,
        "beyond_peak": beyond_peak,
        "harmful": beyond_rms > MORE_RMS or beyond_peak > MORE_PEAK,
        "hand": work.hand,
        "load": work.load,
        "words": work.words,
        "speed": speed,
        "speed_off": speed_off,
        "restrained": float(np.mean(on["phase"][judged] == 4)),
        "faults": law.faults(on),
    }


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


def judge(
    work: Work, kind: str, fault: FaultInjection, faulty: Run, lasting: float, *, bound: float = np.nan
) -> Metrics:
    """Compare a run with a fault with a run without, and with standing motors.

    Metrics are the names that it is given and after how long, s, NaN if not within :data:`NAMED_WITHIN`; and how much
    further off target the tip is than with standing motors (off), and how far outside the hull, deg: before it is named
    (or for that time), and after. A motor that runs away may go as far as its bound, deg.

    lasting: time judged after the fault is named, s.
    """
    off, target = run_off(work)
    healthy = run_on(work)
    found = np.flatnonzero((faulty["operating_state"] == OperatingState.FAULT) & (faulty.time > FAULT))
    named = float(faulty.time[found[0]] - FAULT) if found.size else np.inf
    names = fault_names(int(faulty["faults"][found[0]])) if named <= NAMED_WITHIN else ()
    until = FAULT + min(named, NAMED_WITHIN)
    peers = [off, healthy]
    if names:
        # With the best answer to a fault the motors stand from there on.
        peers.append(run_on(work, pause=until))
    tip, others = np.degrees(faulty["output_angle"]), np.degrees([one["output_angle"] for one in peers])
    hull = np.vstack([target, others])
    outside = np.maximum(tip - hull.max(0), hull.min(0) - tip)
    size = f"{fault.value:+.3g}" + (f" {fault.rate:+.3g}/s" if fault.rate else "")
    said = f"named after {named:.3f} s" if names else "not named"
    words = f"{kind}, {fault.point} {fault.mode} {size}, {said}{f', bound {bound:.2f}°' if bound > 0 else ''}"
    row: Metrics = {"kind": kind, "speed": abs(fault.value), "names": list(names), "named": bool(names), "bound": bound}
    row |= {"seconds": named if names else np.nan, "words": f"{words}\n      {work.words}"}
    for when, start, end in (("before", FAULT, until), ("after", until, until + lasting)):
        during = (faulty.time > start) & (faulty.time <= end)
        error, peer = np.abs(tip - target)[during].max(), np.abs(others[0] - target)[during].max()
        row |= {f"{when}_off": float(error - peer), f"{when}_hull": float(max(outside[during].max(), 0))}
    # What any fault may do is no target of its own.
    over_bound = max(row["before_hull"], row["after_hull"]) / max(bound, MORE_IN_FAULT / MORE_THAN_BOUND)
    return row | {"over_bound": over_bound}


def try_fault(work: Work, kind: str) -> Metrics:
    fault = KINDS[kind](np.random.default_rng([*work.seed, 2]))
    return judge(work, kind, fault, run_on(work, (fault,), relay=RELAY), np.inf)


def try_run_away(work: Work, relay: bool) -> Metrics:
    fault = RUN_AWAY(np.random.default_rng([*work.seed, 3]))
    faulty = run_on(work, (fault,), relay=RELAY if relay else np.inf)
    bound = bound_of(work, fault, faulty if relay else None)
    return judge(work, f"with{'' if relay else 'out'} a relay", fault, faulty, RUN_ON, bound=bound)


def bound_of(work: Work, fault: FaultInjection, cut: Run | None) -> float:
    """Return how far (deg) physics lets a motor that runs away take the tip, with the best that its partner can do.

    It must be noticed first; then the partner, with the same drive, goes along, late by that time. It must stop where
    the other tendon gets slack, or its own gets to the limit. Where its own is slack, a load takes the tip as far as
    the motor lets out; at the limit, the motor pulls it. The joint's stop ends this.

    cut: the run in which a relay ends it; None: there is no relay.
    """
    own, limits = parameters(work.known).axes[0], parameters(work.known).limits[0]
    window = TUNING["watch_window"].value
    common, speed = parameters(work.known).common, abs(fault.value)
    threshold, persistence = limits["motor_not_following"]
    # Unwound, since this has the drive alone.
    alone = Twin(work.known).run(np.zeros(round((RUN_ON + 0.1) / TIME_STEP)), spool_velocity=np.array([-speed, 0.0]))
    path = -alone["spool_angle"][:, 0]
    strayed, kept = np.zeros(path.size), window / (window + TIME_STEP)
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


def trial(  # noqa: PLR0917
    instrument: str,
    seed: int,
    number: int,
    exact: bool,
    assistance: float | None,
    kind: str | None = None,
    relay: bool | None = None,
    changing: bool = False,
    homed: bool = False,
) -> Metrics:
    """Compare random work, or with changes; try a kind of fault, or with or without a relay a motor that runs away."""
    work = make_work(law.instrument(instrument), seed, number, trial=kind is not None or relay is not None)
    known = work.plant if exact else work.known
    if homed:
        known = work.plant.replace(**law.friction(known, 1.0), **{"control.stiffness_uncertainty": HOMED})
    if assistance is not None:
        known = known.replace(**{"control.assistance": assistance})
    work = work._replace(known=known)
    work = changed(work) if changing else work
    return try_fault(work, kind) if kind else compare(work) if relay is None else try_run_away(work, relay)


WORKED = [
    Column("runs, ", len, form="d"),
    Column("worse, ", "worse", np.sum, "d"),
    Column("harmful, ", "harmful", np.sum, "d"),
    Column("worse by an ideal sensor, ", "worse_ideal", np.sum, "d"),
    Column("mean RMS ideal", "rms_ideal"),
    *(
        Column(f"{words} {of or 'on'}", f"rms{of and '_' + of}", over)
        for words, over in (("mean RMS", np.mean), ("median", np.median))
        for of in ("", "off")
    ),
    Column("worst excess over off: RMS", "more_rms", np.max, "+.2f"),
    Column("its peak", "more_peak", np.max, "+.2f"),
    Column("restrained, ", "restrained", form=".1%"),
    Column("tip's speed on, °/s", "speed", np.max, ".0f"),
    Column("its speed off, °/s", "speed_off", np.max, ".0f"),
]
FAULTY = [
    Column("runs, ", len, form="d"),
    Column("named, ", "named", np.sum, "d"),
    Column("median, s", lambda rows: np.median(seconds(rows)), form=".3f"),
    Column("longest, s", lambda rows: np.max(seconds(rows)), form=".3f"),
    *(
        Column(f"{words} {of}", f"{when}_{of}", np.max, form)
        for when, words in (("before", "until named:"), ("after", "then:"))
        for of, form in (("off", "+.2f"), ("hull", ".2f"))
    ),
]
NAMES = Column("names", lambda rows: law.counts(named_in(rows)), form="")
BOUNDED = [
    Column("hull over bound: median, ", "over_bound", np.median),
    Column("hull over bound: worst, ", "over_bound", np.max),
]
SPEEDS = (0.3, 1, 3, 10, 21)  # rad/s


def seconds(rows: Rows) -> Any:
    return [row["seconds"] for row in rows if row["named"]] or [np.nan]


def named_in(rows: Rows) -> Counter[str]:
    return Counter(",".join(row["names"]) for row in rows if row["named"])


def report_work(options: Namespace, rows: Rows, name: str = "harm") -> None:
    print("no faults, error of the tip in deg")
    in_order = Rows(sorted(rows, key=lambda row: (row["hand"], row["load"])))
    print(campaign.table(in_order.by("hand", "load"), WORKED, ("hand", "load")))
    known = "_exact" * options.exact + "_homed" * options.homed
    seeds = {f"seed {seed}": own for seed, own in rows.by("seed").items()} if len(options.seed) > 1 else {}
    law.show(options, name + known, rows.by("instrument") | seeds | {"all": rows}, WORKED, "instrument or seed")
    print(campaign.verdict(f"RMS beyond off and ideal by more than {MORE_RMS:g}°", rows, "beyond_rms", MORE_RMS))
    print(campaign.verdict(f"peak beyond off and ideal by more than {MORE_PEAK:g}°", rows, "beyond_peak", MORE_PEAK))
    print(campaign.verdict(f"RMS beyond off by more than {MORE_RMS:g}°", rows, "more_rms", MORE_RMS))
    print(campaign.verdict(f"peak beyond off by more than {MORE_PEAK:g}°", rows, "more_peak", MORE_PEAK))
    print(campaign.verdict("faults raised", rows, lambda row: len(row["faults"])))


def report_faults(options: Namespace, rows: Rows) -> None:
    print(f"one fault each at {FAULT:g} s: the tip in deg beyond motors off, and outside the hull")
    law.show(options, "harm_faults", rows.by("kind") | {"all": rows}, [*FAULTY, NAMES], "fault")
    beyond = f"beyond motors off by more than {MORE_IN_FAULT:g}°"
    print(campaign.verdict(f"{beyond} until it is named", rows, "before_off", MORE_IN_FAULT))
    print(campaign.verdict(f"{beyond} from then on", rows, "after_off", MORE_IN_FAULT))


def report_run_aways(options: Namespace, rows: Rows) -> None:
    print(f"a motor that runs away at {FAULT:g} s, and the next second")
    for kind, own in rows.by("kind").items():
        bands = {"all": own} | {
            f"{low:g} to {min(high, 20):g} {kind}": Rows(row for row in own if low <= row["speed"] < high)
            for low, high in pairwise(SPEEDS)
        }
        found = {label: band for label, band in bands.items() if band}
        law.show(options, f"harm_{figures.slug(kind)}", found, [*FAULTY, *BOUNDED], "rad/s")
        print(campaign.verdict(f"{kind} beyond {MORE_THAN_BOUND:g} of the bound", own, "over_bound", MORE_THAN_BOUND))


def main() -> None:
    parser = law.arguments(__doc__, RATED)
    parser.add_argument("--runs", type=int, default=200, help="without faults, of each seed")
    parser.add_argument("--faults", type=int, default=120, help="runs with one each, of each seed")
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    parser.add_argument("--exact", action="store_true", help="the law knows friction and stiffness as they are")
    parser.add_argument("--homed", action="store_true", help="the law knows the stiffness, as after homing")
    parser.add_argument("--assistance", type=float, help="share of the lost angle that the law gives back")
    options = parser.parse_args()
    names = options.instrument or [*RATED]
    fixed = {"exact": options.exact, "homed": options.homed, "assistance": options.assistance}

    def cases(count: int, **also: Any) -> list[Metrics]:
        each = campaign.cases(seed=options.seed, number=range(count))
        return [{"instrument": names[case["number"] % len(names)], **case, **fixed, **also} for case in each]

    def rows(title: str, given: Iterable[Metrics]) -> Rows:
        return campaign.run(trial, given, title, results=options.results)

    if options.runs:
        report_work(options, rows("without faults", cases(options.runs)))
        report_work(options, rows("changing", cases(options.runs, changing=True)), "harm_changing")
    if not options.faults:
        return
    # In pairs, so that each kind comes to each instrument.
    kinds = list(KINDS)
    faults = [case | {"kind": kinds[case["number"] // len(names) % len(kinds)]} for case in cases(options.faults)]
    report_faults(options, rows("faults", sorted(faults, key=lambda case: kinds.index(case["kind"]))))
    away = [case for relay in (False, True) for case in cases(options.faults // 2, relay=relay)]
    report_run_aways(options, rows("run-aways", away))


if __name__ == "__main__":
    main()
