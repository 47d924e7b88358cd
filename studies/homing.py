"""What homing does to the tip, and what it says: random starts with one thing wrong each, and healthy ones.

Peer: the same instrument with its motors standing, from the same state. There is a fault in each of the first starts:
a load on the tip, a load cell that is not tared, cables swapped or reversed, a gain, a motor without power, a broken or
jammed tendon; the tip should stay within 3 degrees of the peer's, and the reason be the right one. Healthy starts, with
friction and stiffness other than the controller assumes, should all end at the pretension.
"""

import functools
from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import figures
import law
import numpy as np
from currents import GEARED

import tenodesis as tn
from tenodesis.control import Controller, OperatingState, Request
from tenodesis.control.controller import fault_names, homing_failure
from tenodesis.instrument import Instrument
from tenodesis.run import Run, concatenate
from tenodesis.simulate import FaultInjection, campaign
from tenodesis.simulate.campaign import Column, Rows
from tenodesis.twin import TIME_STEP, Twin

Random = np.random.Generator

RATED = law.RATED | {"pulley wrist": 0.52, "continuum tip": 0.52}  # N
LONGEST, PART = 40.0, 0.5  # s
ALLOWED, REPEATABLE = 3.0, 0.02  # deg, share of the pretension


class HomingCase(NamedTuple):
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


def healthy(inst: Instrument, random: Random) -> HomingCase:
    slack = 0.0 if random.random() < 0.3 else float(np.exp(random.uniform(np.log(0.2e-3), np.log(10e-3))))
    plant = inst.replace(**law.friction(inst, float(np.exp(random.uniform(np.log(0.5), np.log(2))))))
    bend = float(random.uniform(0, np.pi / 2))
    known = law.differing(inst, stiffness=float(random.uniform(0.7, 1.3)))
    return HomingCase(plant, known, slack, bend, int(random.integers(1 << 30)))


def loaded(case: HomingCase, random: Random) -> HomingCase:
    force = RATED[case.plant.name] * random.uniform(-1, 1)
    return case._replace(force=force, label="load on the tip", right=("tip_loaded",))


def untared(case: HomingCase, random: Random) -> HomingCase:
    side = random.choice(["agonist", "antagonist"])
    bias = random.uniform(-5, 5)
    right = (f"cell_offset.{side}", "load_cell_range")
    return case._replace(faults=inject((f"tension.{side}", "add", bias)), label="cell not tared", right=right)


def broken(case: HomingCase, random: Random) -> HomingCase:
    side = int(random.integers(2))
    # Whatever was taut before is slack then.
    return case._replace(
        broken=side, label="tendon broken", right=(f"tendon_broken.{('agonist', 'antagonist')[side]}",)
    )


def jammed(case: HomingCase, random: Random) -> HomingCase:
    jam = {"friction.law": "capstan", "friction.sheath_coefficient": 3.0, "friction.sheath_bend": np.pi}
    names = ("tendon_jammed.agonist", "tendon_jammed.antagonist")
    return case._replace(plant=case.plant.replace(**jam), bend=0.0, label="tendons jammed", right=names)


def wrongly_wired(name: str) -> Callable[[HomingCase, Random], HomingCase]:
    def wired(case: HomingCase, random: Random) -> HomingCase:
        faults, right = wiring(str(random.choice(["agonist", "antagonist"])))[name]
        return case._replace(faults=faults, label=name, right=right)

    return wired


WRONG: tuple[Callable[[HomingCase, Random], HomingCase], ...] = (
    *(loaded,) * 6,
    *(untared,) * 4,
    broken,
    jammed,
    *map(wrongly_wired, wiring("agonist")),
)


def draw(inst: Instrument, number: int, wrong: bool) -> HomingCase:
    """Return a case, one of a number of random ones, healthy or with one thing wrong."""
    random = np.random.default_rng([number, wrong, len(inst.name)])
    case = healthy(inst, random)
    if wrong:
        return WRONG[number % len(WRONG)](case, random)
    return case._replace(handle=0.0 if number % 3 else float(random.uniform(-0.6, 0.6)))


def home(case: HomingCase) -> dict[str, Any]:
    """Home in a case, and do the same with the motors standing.

    Metrics are the answer (reason, or else the faults; empty if it ended well); the largest distance of the tip from
    where it was and would have gone with standing motors (moved), and of where the handle wants it at the end (off),
    deg; the error of the mean tension and half the difference of the tensions (apart), as shares of the pretension.
    """
    twin = Twin(case.plant, seed=case.seed)
    if case.slack:
        twin.loosen(case.slack)
    ease = np.minimum(1, np.arange(1, 2001) / 1600)
    torn = np.zeros(2)
    if case.broken is not None:
        torn[case.broken] = 0.5
    twin.run(case.handle * ease**2 * (3 - 2 * ease), case.force * ease, sheath_bend=case.bend * ease, let_out=torn)
    # Until a tip that falls has come to rest.
    twin.run(np.full(12000, case.handle), case.force, sheath_bend=case.bend, let_out=torn)
    standing = Twin(case.plant, seed=case.seed)
    standing.state = twin.state
    controller = Controller(case.known, homed=False, enabled=False)
    injected = [replace(one, start=twin.time) for one in case.faults]
    count = round(PART / TIME_STEP)
    request = np.zeros(count, int)
    request[100] = Request.HOME
    runs: list[Run] = []
    begun = twin.time
    arguments = {"sheath_bend": case.bend, "let_out": torn}
    while twin.time - begun < LONGEST:
        runs.append(
            twin.run(
                np.full(count, case.handle),
                case.force,
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
    peer = standing.run(np.full(run.time.size, case.handle), case.force, **arguments)
    state = run["operating_state"]
    mask = int(np.bitwise_or.reduce(run["faults"].astype(int)[200:]))
    answer = homing_failure(int(run["homing_failure"][-1])) or ",".join(fault_names(mask))
    if not answer and state[-1] != OperatingState.PAUSED:
        answer = "not ended"
    tip, off = run["output_angle"], peer["output_angle"]
    moved = np.degrees(max(off.min() - tip.min(), tip.max() - off.max()))
    tension = run["tension"][-1] / case.plant.pretension
    error, apart = abs(tension.mean() - 1), abs(tension[0] - tension[1]) / 2
    ended = np.flatnonzero(state[200:] != OperatingState.ENABLED)
    seconds = float(ended[0] + 100) * TIME_STEP if ended.size else np.nan
    target = tn.statics.output_angle(case.plant, case.handle, 0.0)
    answered = any(answer.startswith(name) for name in case.right)
    return {
        "label": case.label,
        "answer": answer,
        "refused": bool(answer),
        "right": bool(answer) and answered,
        "other": answer if answer and not answered else "",
        "moved": moved,
        "pretension": error,
        "apart": apart,
        "either": error + apart,
        "off": np.degrees(abs(tip[-1] - target)),
        "seconds": seconds,
        "straight": case.handle == 0,
        "size": abs(case.force) or (abs(case.faults[0].value) if case.faults else 0.0),
    }


@functools.cache
def instrument(name: str, currents: bool) -> Instrument:
    return law.instrument(name).replace(**GEARED if currents else {})


def trial(name: str, number: int, wrong: bool, currents: bool) -> dict[str, Any]:
    return home(draw(instrument(name, currents), number, wrong))


ENDED = [
    Column("starts, ", len, form="d"),
    Column("refused, ", "refused", np.sum, "d"),
    Column("rightly named, ", "right", np.sum, "d"),
    Column("tip moved, deg", "moved", np.max),
    Column("longest, s", "seconds", np.max, ".1f"),
    Column("other answers", "other", lambda values: ", ".join(sorted({*values} - {""})), ""),
]


def report_wrong(options: Namespace, name: str, rows: Rows) -> None:
    name = f"homing_{figures.slug(name)}{'_currents' if options.currents else ''}"
    law.show(options, name, rows.by("label") | {"all": rows}, ENDED, "what is wrong")
    print(campaign.verdict(f"tip moved beyond {ALLOWED:g}°", rows, "moved", ALLOWED))
    for label in ("load on the tip", "cell not tared"):
        taken = rows.where(label=label, refused=False)
        if taken:
            most, off = taken["size"].max(), taken["off"].max()
            print(f"  {label}, but homed: {len(taken)}, with {most:.3f} N at most, tip {off:.2f}° off")


def report_healthy(rows: Rows) -> None:
    homed, refused = rows.where(refused=False), sorted(rows.where(refused=True).by("answer"))
    print(f"  healthy: {len(rows)} starts, {len(rows) - len(homed)} refused {refused or ''}   target 0")
    straight = homed.where(straight=True)
    for words, error in (
        ("mean tension", homed["pretension"].max()),
        ("with a straight handle either tension", straight["either"].max()),
    ):
        print(f"  {words} within {100 * error:.2f} %   target {100 * REPEATABLE:g} %")
    print(f"  and the tip moved {straight['moved'].max():.2f}° at most")
    print(f"  the tip ends {homed['off'].max():.2f}° off target at most")
    print(f"  {np.median(homed['seconds']):.1f} s in the median, {homed['seconds'].max():.1f} s at most")


def report_known(inst: Instrument) -> None:
    """Report the cases in which homing was once seen to do harm."""
    case = HomingCase(inst, inst, 0.0, 0.0, 1)
    forces = (0.3, 0.74) if inst.name == "scaled-up" else (0.1, 0.26)
    cases = [(f"{force:g} N on the tip, from the pretension", case._replace(force=force)) for force in forces]
    for bias in (2.0, 5.0):
        faults = inject(("tension.agonist", "add", bias))
        cases.append((f"agonist's cell {bias:+g} N, from slack", case._replace(slack=2e-3, faults=faults)))
    for name in ("load cells swapped", "motors with encoders swapped"):
        cases.append((f"{name}, from slack", case._replace(slack=2e-3, faults=wiring("agonist")[name][0])))
    for label, case in cases:
        end = home(case)
        answer = end["answer"] or "homed"
        print(f"  {label:48s} tip moved {end['moved']:5.2f}°, {answer} after {end['seconds']:.2f} s")


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--starts", type=int, default=500, help="of each kind and instrument")
    parser.add_argument("--currents", action="store_true", help="motor currents, gear of 0.9, in place of load cells")
    parser.add_argument("instruments", nargs="*", default=["real-size", "scaled-up"], help="names or files")
    options = parser.parse_args()
    for name in options.instruments:
        numbers = range(options.starts)
        cases = campaign.cases(name=[name], wrong=(True, False), number=numbers, currents=[options.currents])
        print(f"{instrument(name, options.currents).name}:")
        report_known(instrument(name, options.currents))
        rows = campaign.run(trial, cases, name, results=options.results)
        report_wrong(options, name, rows.where(wrong=True))
        report_healthy(rows.where(wrong=False))


if __name__ == "__main__":
    main()
