"""What homing does to the tip, and what it says: random starts with one thing wrong each, and healthy ones.

Peer: the same instrument with its motors standing, from the same state. There is a fault in each of the first starts:
a load on the tip, a load cell that is not tared, cables swapped or reversed, a gain, a motor without power, a broken or
jammed tendon; the tip should stay within 3 degrees of the peer's, and the reason be the right one. Healthy starts, with
friction and stiffness other than the controller assumes, should all end at the pretension.
"""

import argparse
import os
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from currents import GEARED
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.control import FAULTS, Controller, OperatingState, Request, homing_failure
from tenodesis.instrument import Instrument
from tenodesis.run import Run, concatenate
from tenodesis.simulate import FaultInjection
from tenodesis.twin import TIME_STEP, Twin

Array = NDArray[np.float64]
Random = np.random.Generator

RATED = {"scaled-up": 1.485, "real-size": 0.52, "pulley wrist": 0.52, "continuum tip": 0.52}  # N
LONGEST, PART = 40.0, 0.5  # s
ALLOWED, REPEATABLE = 3.0, 0.02  # deg, share of the pretension


class Start(NamedTuple):
    """An instrument before homing, and what is wrong."""

    plant: Instrument
    known: Instrument
    slack: float
    """Length let out on both tendons, m; 0: at their pretension."""
    bend: float
    """Of the sheath, beyond the instrument's, rad."""
    seed: int
    handle: float = 0.0
    force: float = 0.0
    faults: tuple[FaultInjection, ...] = ()
    broken: int | None = None
    label: str = ""
    right: tuple[str, ...] = ()
    """The answers that name the fault."""


class End(NamedTuple):
    """How homing ended."""

    start: Start
    answer: str
    """Reason, or else the faults; empty if it ended well."""
    moved: float
    """Largest distance of the tip from where it was and would have gone with standing motors, deg."""
    pretension: float
    """Error of the mean tension, share of the pretension."""
    apart: float
    """Half the difference of the tensions, share of the pretension."""
    off: float
    """Distance of the tip from where the handle wants it, deg."""
    seconds: float


def inject(*faults: tuple[str, str, float]) -> tuple[FaultInjection, ...]:
    return tuple(FaultInjection(point, mode, value) for point, mode, value in faults)  # type: ignore[arg-type]


def wiring(side: str) -> dict[str, tuple[tuple[FaultInjection, ...], tuple[str, ...]]]:
    """Faults of cables and gains at one tendon, and their right answers; slack tendons show less than taut ones."""
    velocity, angle, tension = f"spool_velocity.{side}", f"spool_angle.{side}", f"tension.{side}"
    other = "antagonist" if side == "agonist" else "agonist"
    reverse, swap = ("scale", -1.0), ("swap", 0.0)
    apart = (f"cell_gains_apart.{side}",)
    far_apart = (f"cell_gains_apart.{other}",)
    return {
        "load cells swapped": (inject((tension, *swap)), ("cells_swapped",)),
        "motors with encoders swapped": (inject((velocity, *swap), (angle, *swap)), ("cells_swapped",)),
        "motors swapped": (inject((velocity, *swap)), ("motors_swapped",)),
        "encoders swapped": (inject((angle, *swap)), ("encoders_swapped", "motors_swapped")),
        "motor reversed": (inject((velocity, *reverse)), (f"motor_reversed.{side}",)),
        "encoder reversed": (inject((angle, *reverse)), (f"encoder_reversed.{side}", f"motor_reversed.{side}")),
        "motor with encoder reversed": (inject((velocity, *reverse), (angle, *reverse)), (f"spool_reversed.{side}",)),
        "both motors with encoders reversed": (
            inject(
                *((f"{point}.{one}", *reverse) for point in ("spool_velocity", "spool_angle") for one in (side, other))
            ),
            ("spool_reversed.agonist", "tendons_slack"),
        ),
        "cell reversed": (inject((tension, *reverse)), (f"cell_reversed.{side}", "load_cell_range")),
        "motor without power": (inject((velocity, "set", 0.0)), (f"motor_dead.{side}",)),
        "encoder dead": (inject((angle, "scale", 0.0)), (f"motor_dead.{side}",)),
        "encoder gain 0.5": (inject((angle, "scale", 0.5)), (f"encoder_gain.{side}",)),
        "encoder gain 2": (inject((angle, "scale", 2.0)), (f"encoder_gain.{side}",)),
        "cell gain 0.5": (inject((tension, "scale", 0.5)), apart),
        "cell gain 0.8": (inject((tension, "scale", 0.8)), apart),
        "cell gain 1.25": (inject((tension, "scale", 1.25)), far_apart),
        "cell gain 2": (inject((tension, "scale", 2.0)), far_apart),
    }


def with_friction(inst: Instrument, factor: float) -> Instrument:
    return inst.replace(
        **{
            f"friction.{name}": getattr(inst.friction, name) * factor
            for name in ("vertex_coefficient", "sheath_coefficient")
        }
    )


def assumed(inst: Instrument, factor: float) -> Instrument:
    """Return the instrument with a stiffness that is wrong by a factor."""
    true = inst.tendon_stiffness * inst.mismatch.stiffness_ratio
    return inst.replace(tendon_stiffness=true * factor, mismatch=inst.mismatch.model_dump() | {"stiffness_ratio": 1.0})


def healthy(inst: Instrument, random: Random) -> Start:
    slack = 0.0 if random.random() < 0.3 else float(np.exp(random.uniform(np.log(0.2e-3), np.log(10e-3))))
    plant = with_friction(inst, float(np.exp(random.uniform(np.log(0.5), np.log(2)))))
    bend = float(random.uniform(0, np.pi / 2))
    known = assumed(inst, float(random.uniform(0.7, 1.3)))
    return Start(plant, known, slack, bend, int(random.integers(1 << 30)))


def loaded(start: Start, random: Random) -> Start:
    force = RATED[start.plant.name] * random.uniform(-1, 1)
    return start._replace(force=force, label="load on the tip", right=("tip_loaded",))


def untared(start: Start, random: Random) -> Start:
    side = random.choice(["agonist", "antagonist"])
    bias = random.uniform(-5, 5)
    right = (f"cell_offset.{side}", "load_cell_range")
    return start._replace(faults=inject((f"tension.{side}", "add", bias)), label="cell not tared", right=right)


def broken(start: Start, random: Random) -> Start:
    side = int(random.integers(2))
    # Whatever was taut before is slack then.
    return start._replace(
        broken=side, label="tendon broken", right=(f"tendon_broken.{('agonist', 'antagonist')[side]}",)
    )


def jammed(start: Start, random: Random) -> Start:
    jam = {"friction.law": "capstan", "friction.sheath_coefficient": 3.0, "friction.sheath_bend": np.pi}
    names = ("tendon_jammed.agonist", "tendon_jammed.antagonist")
    return start._replace(plant=start.plant.replace(**jam), bend=0.0, label="tendons jammed", right=names)


def wrongly_wired(name: str) -> Callable[[Start, Random], Start]:
    def wired(start: Start, random: Random) -> Start:
        faults, right = wiring(str(random.choice(["agonist", "antagonist"])))[name]
        return start._replace(faults=faults, label=name, right=right)

    return wired


WRONG: tuple[Callable[[Start, Random], Start], ...] = (
    *(loaded,) * 6,
    *(untared,) * 4,
    broken,
    jammed,
    *map(wrongly_wired, wiring("agonist")),
)


def starts(inst: Instrument, count: int, wrong: bool) -> Iterator[Start]:
    for n in range(count):
        random = np.random.default_rng([n, wrong, len(inst.name)])
        start = healthy(inst, random)
        if wrong:
            yield WRONG[n % len(WRONG)](start, random)
        else:
            yield start._replace(handle=0.0 if n % 3 else float(random.uniform(-0.6, 0.6)))


def home(start: Start) -> End:
    """Home from a start, and do the same with the motors standing."""
    twin = Twin(start.plant, seed=start.seed)
    if start.slack:
        twin.loosen(start.slack)
    ease = np.minimum(1, np.arange(1, 2001) / 1600)
    torn = np.zeros(2)
    if start.broken is not None:
        torn[start.broken] = 0.5
    twin.run(start.handle * ease**2 * (3 - 2 * ease), start.force * ease, sheath_bend=start.bend * ease, let_out=torn)
    # Until a tip that falls has come to rest.
    twin.run(np.full(12000, start.handle), start.force, sheath_bend=start.bend, let_out=torn)
    standing = Twin(start.plant, seed=start.seed)
    standing.state = twin.state
    controller = Controller(start.known, homed=False, enabled=False)
    injected = [replace(one, start=twin.time) for one in start.faults]
    count = round(PART / TIME_STEP)
    request = np.zeros(count, int)
    request[100] = Request.HOME
    runs: list[Run] = []
    begun = twin.time
    arguments = {"sheath_bend": start.bend, "let_out": torn}
    while twin.time - begun < LONGEST:
        runs.append(
            twin.run(
                np.full(count, start.handle),
                start.force,
                controller=controller,
                request=request,
                fault_injection=injected,
                **arguments,
            )
        )
        request[:] = 0
        if runs[-1]["operating_state"][0] != OperatingState.ENABLED and len(runs) > 1:
            break
    run = concatenate(runs)
    peer = standing.run(np.full(run.time.size, start.handle), start.force, **arguments)
    state = run["operating_state"]
    mask = int(np.bitwise_or.reduce(run["faults"].astype(int)[200:]))
    answer = homing_failure(int(run["homing_failure"][-1])) or ",".join(
        n for k, n in enumerate(FAULTS) if mask >> k & 1
    )
    if not answer and state[-1] != OperatingState.PAUSED:
        answer = "not ended"
    tip, off = run["output_angle"], peer["output_angle"]
    moved = np.degrees(max(off.min() - tip.min(), tip.max() - off.max()))
    tension = run["tension"][-1] / start.plant.pretension
    error, apart = abs(tension.mean() - 1), abs(tension[0] - tension[1]) / 2
    ended = np.flatnonzero(state[200:] != OperatingState.ENABLED)
    seconds = float(ended[0] + 100) * TIME_STEP if ended.size else np.nan
    target = tn.statics.output_angle(start.plant, start.handle, 0.0)
    return End(
        start, answer, float(moved), float(error), float(apart), float(np.degrees(abs(tip[-1] - target))), seconds
    )


def report_wrong(ends: list[End]) -> None:
    by_label = defaultdict(list)
    for end in ends:
        by_label[end.start.label].append(end)
    print("  what is wrong                       starts  refused  rightly named  tip moved  longest  other answers")
    for label, own in by_label.items():
        refused = [end for end in own if end.answer]
        named = [end for end in refused if any(end.answer.startswith(name) for name in end.start.right)]
        others = sorted({end.answer for end in refused if end not in named})
        print(
            f"  {label:36s}{len(own):5d}{len(refused):9d}{len(named):15d}{max(end.moved for end in own):10.2f}°"
            f"{max(end.seconds for end in own):7.1f} s  {', '.join(others)}"
        )
    refused = [end for end in ends if end.answer]
    right = sum(any(end.answer.startswith(name) for name in end.start.right) for end in refused)
    worst = max(end.moved for end in ends)
    print(f"  all: {len(ends)} starts, {len(refused)} refused, {right} with the right reason; tip moved {worst:.2f}°")
    print(f"  beyond {ALLOWED:g}°: {sum(end.moved > ALLOWED for end in ends)}   target 0")
    for label in ("load on the tip", "cell not tared"):
        taken = [end for end in by_label[label] if not end.answer]
        force = [abs(end.start.force) or abs(end.start.faults[0].value) for end in taken]
        tips = [end.off for end in taken]
        if taken:
            print(f"  {label}, but homed: {len(taken)}, with {max(force):.3f} N at most, tip {max(tips):.2f}° off")


def report_healthy(ends: list[End]) -> None:
    homed = [end for end in ends if not end.answer]
    refused = sorted(end.answer for end in ends if end.answer)
    print(f"  healthy: {len(ends)} starts, {len(refused)} refused {refused or ''}   target 0")
    straight = [end for end in homed if end.start.handle == 0]
    error, either = max(end.pretension for end in homed), max(end.pretension + end.apart for end in straight)
    print(f"  mean tension within {100 * error:.2f} %   target {100 * REPEATABLE:g} %")
    print(f"  with a straight handle either tension within {100 * either:.2f} %   target {100 * REPEATABLE:g} %")
    print(f"  and the tip moved {max(end.moved for end in straight):.2f}° at most")
    seconds = [end.seconds for end in homed]
    print(f"  the tip ends {max(end.off for end in homed):.2f}° off target at most")
    print(f"  {np.median(seconds):.1f} s in the median, {max(seconds):.1f} s at most")


def report_known(inst: Instrument) -> None:
    """Report the cases in which homing was once seen to do harm."""
    start = Start(inst, inst, 0.0, 0.0, 1)
    forces = (0.3, 0.74) if inst.name == "scaled-up" else (0.1, 0.26)
    cases = [(f"{force:g} N on the tip, from the pretension", start._replace(force=force)) for force in forces]
    for bias in (2.0, 5.0):
        faults = inject(("tension.agonist", "add", bias))
        cases.append((f"agonist's cell {bias:+g} N, from slack", start._replace(slack=2e-3, faults=faults)))
    for name in ("load cells swapped", "motors with encoders swapped"):
        cases.append((f"{name}, from slack", start._replace(slack=2e-3, faults=wiring("agonist")[name][0])))
    for label, case in cases:
        end = home(case)
        print(f"  {label:48s} tip moved {end.moved:5.2f}°, {end.answer or 'homed'} after {end.seconds:.2f} s")


def main() -> None:
    # Faults are results here.
    warnings.simplefilter("ignore", tn.errors.FaultWarning)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--starts", type=int, default=500, help="of each kind and instrument")
    parser.add_argument("--currents", action="store_true", help="motor currents, gear of 0.9, in place of load cells")
    parser.add_argument("instruments", nargs="*", default=["real-size", "scaled-up"], help="names or files")
    options = parser.parse_args()
    for name in options.instruments:
        inst = tn.load(name)
        inst = inst.axis(inst.axes[0]).replace(**GEARED if options.currents else {})
        begun = time.perf_counter()
        print(f"{inst.name}:")
        report_known(inst)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            report_wrong(list(pool.map(home, starts(inst, options.starts, True))))
            report_healthy(list(pool.map(home, starts(inst, options.starts, False))))
        print(f"  {time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
