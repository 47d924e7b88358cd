"""Speed of the twin, as ratios against MuJoCo measured in the same run.

Peer: MuJoCo on the same instrument without friction, which its model cannot represent; the twin has
full friction, drives and sensors.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from timeit import timeit

import numpy as np
from numpy.typing import NDArray
from peers import chain_dynamics
from turns import in_turns, rate, said, times_faster

import tenodesis as tn
from tenodesis import _core
from tenodesis.instrument import Instrument
from tenodesis.twin import TIME_STEP, Twin, run_many
from tenodesis.twin.axes_core import axes_twin
from tenodesis.twin.rows import columns_by_name

Array = NDArray[np.float64]

STEPS = 400_000
ROUNDS = 7
RUNS = 10_000
CHUNK = 500
TARGET_STEPS = 5e6
TARGET_RATIO = 15.0
TARGET_LANES = {8: 25e6, 4: 12e6, 2: 12e6}
TARGET_LANES_RATIO = 60.0
TARGET_TICKS = 4e6
TARGET_CHAIN_STEPS = 1.5e6
TARGET_CHAIN_RATIO = 8.0
CHAIN_FRICTION = {"law": "capstan", "vertex_coefficient": 0.15, "sheath_coefficient": 0.1, "sheath_bend": 0.35}
OUTPUTS = (0.0, 33.0, 67.0, 80.0)  # deg, Fig. 15
WEIGHT = 10.0  # N on the rig's cable
SIGNALS = ("output_angle", "tension.agonist", "tension.antagonist")
EVERY = 20
WIDEST = 8
"""Twins side by side in the widest vectors."""


def motions(inst: Instrument) -> dict[str, tuple[Array, Array]]:
    """Handle angle (rad) and force (N), shape (n,), of some typical motions."""
    t = np.arange(1, STEPS + 1) * TIME_STEP
    reach = float(tn.statics.handle_angle(inst, inst.output_range))
    slack = float(tn.statics.slack_force(inst, 0.0))
    still = np.zeros(STEPS)
    return {
        "held under load": (still, still + 0.2 * slack),
        "handle cycles of 0.5 Hz": (0.8 * reach * np.sin(np.pi * t), still),
        "cycles under a varying load": (0.6 * reach * np.sin(np.pi * t), 0.3 * slack * np.sin(7 * t)),
        "step loads that slacken": (0.3 * reach * np.sin(np.pi * t), 0.9 * slack * np.sign(np.sin(5 * t))),
    }


def single(inst: Instrument) -> None:
    """Steps per second of one axis on one core: with every signal kept, and stepping alone against MuJoCo, alternately.

    MuJoCo also steps alone, in its fastest configuration, without sensors or outputs.
    """
    tn.set_threads(1)
    print(f"{inst.name}, one axis, {inst.friction.law} friction, one core, steps of {1e3 * TIME_STEP:g} ms:")
    for name, (handle, force) in motions(inst).items():
        twin = Twin(inst)
        twin.run(handle[:20000], force[:20000])
        ours, alone, theirs = in_turns(
            ROUNDS,
            rate(STEPS, partial(twin.run, handle, force)),
            rate(STEPS, partial(run_many, inst, handle, force, every=STEPS)),
            mujoco(inst),
        )
        said(f"{name}, every signal kept", ours, "M steps/s", TARGET_STEPS / 1e6)
        times_faster("MuJoCo, stepping alone", alone, theirs, TARGET_RATIO)


def mujoco(inst: Instrument) -> Callable[[], float]:
    """Return what measures MuJoCo's steps a second of an instrument without friction."""
    smooth = inst.replace(friction=None, mismatch=None)
    return partial(chain_dynamics.steps_per_second, smooth.expanded, [0.0] * 6, seconds=0.2, as_exported=False)


def lanes(inst: Instrument) -> None:
    """Steps per second of many twins on one core, alone and in lanes, and of loops closed by the robust law."""
    tn.set_threads(1)
    runs, steps = 64, 8000
    coefficients = np.linspace(0.02, 0.3, runs)
    own = [inst.replace(**{"friction.vertex_coefficient": one.item()}) for one in coefficients]
    cores = [axes_twin(one, TIME_STEP, n, False) for n, one in enumerate(own)]

    def stepped(commands: Array, most_lanes: int) -> Callable[[], float]:
        def measured() -> float:
            # Twins are made anew, since they go on from where they were.
            return rate(runs * steps, advancing(_core.TwinBatch(cores, most_lanes=most_lanes), cores, commands))()

        return measured

    widest = _core.TwinBatch(cores[:8]).together
    print(f"{inst.name}, {runs} twins with all their friction on one core, {widest} side by side:")
    for name, (handle, force) in motions(inst).items():
        commands = np.stack([handle[:steps], force[:steps]], axis=-1)[np.newaxis]
        together, alone, theirs = in_turns(ROUNDS, stepped(commands, widest), stepped(commands, 1), mujoco(inst))
        said(name, together, "M steps/s", TARGET_LANES[widest] / 1e6)
        times_faster("one by one", together, alone)
        times_faster("MuJoCo on one core", together, theirs, TARGET_LANES_RATIO)
    handle, force = (one[:steps] for one in motions(inst)["cycles under a varying load"])

    def closed() -> object:
        controllers = [tn.control.Controller(inst) for _ in range(runs)]
        return run_many([inst] * runs, handle, force, controllers=controllers, every=EVERY)

    said("loops with the robust law", *in_turns(3, rate(runs * steps, closed)), "M ticks/s", TARGET_TICKS / 1e6)


def stepping(inst: Instrument, most_lanes: int, steps: int) -> tuple[Callable[[], None], int]:
    """Return what steps as many twins as vectors hold at most, under a varying load, and how many are side by side."""
    cores = [axes_twin(inst, TIME_STEP, n, False) for n in range(WIDEST)]
    twins = _core.TwinBatch(cores, most_lanes=most_lanes)
    commands = np.stack([one[:steps] for one in motions(inst)["cycles under a varying load"]], axis=-1)[np.newaxis]
    return advancing(twins, cores, commands), twins.together


def advancing(twins: _core.TwinBatch, cores: list[_core.Twin], commands: Array) -> Callable[[], None]:
    """Return what steps twins over common handle angles and forces, and keeps output angles."""
    columns, signals = columns_by_name(cores[0].commands), columns_by_name(cores[0].signals)
    given = [columns["handle_angle"].start, columns["force"].start]
    out, ends = np.empty((len(cores), 1, commands.shape[1] // EVERY)), np.zeros((len(cores), 2), np.int64)
    return partial(
        twins.advance, commands, given, [signals["output_angle"].start], EVERY, out, ends, 1, [], [], 1, TIME_STEP
    )


def instructions(inst: Instrument) -> None:
    """Print instructions and time of a step of one twin, alone and in lanes; valgrind counts up to AVX2."""
    print(f"{inst.name}, one step of one twin, cycles under a varying load:")
    steps = 8_000
    for lanes in (1, 2, 4, WIDEST):
        advance, together = stepping(inst, lanes, steps)
        if together != lanes:
            continue
        spent = min(timeit(advance, number=1) for _ in range(ROUNDS)) / (steps * WIDEST)
        counted = "  not counted"
        if lanes < WIDEST:
            few, many = (collected(inst.name, lanes, count) for count in (EVERY, steps))
            counted = f"{(many - few) / ((steps - EVERY) * WIDEST):6.0f} instructions"
        print(f"  {lanes} side by side   {counted}   {1e9 * spent:6.1f} ns")


def collected(name: str, lanes: int, steps: int) -> int:
    """Return the instructions of a process from its first step on."""
    valgrind = ["valgrind", "--tool=callgrind", "--instr-atstart=no", "--callgrind-out-file=/dev/null"]
    command = [*valgrind, sys.executable, __file__, "--only-steps", name, str(lanes), str(steps)]
    counted = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    return int(counted.partition("Collected : ")[2].split()[0])


def two_axes() -> None:
    """Steps per second of two axes that share tendons, on one core, against MuJoCo, alternately."""
    smooth = tn.instrument.expanded(tn.load("real-size").replace(axes=("yaw", "pitch")))
    inst = smooth.replace(friction=CHAIN_FRICTION)
    t = TIME_STEP * np.arange(1, STEPS // 10 + 1)[:, np.newaxis]
    cycle = 2 / np.pi * np.arcsin(np.sin(2 * np.pi * t))
    twin = tn.twin.Twin(inst, time_step=TIME_STEP)
    handle, wrench = cycle * [0.4, -0.3], cycle * [0.3, 0.2, 0, 0, 0, 0]
    run = partial(twin.run, handle, wrench=wrench)
    run()
    tn.set_threads(1)
    many = partial(run_many, [inst] * WIDEST, handle, wrench=wrench, every=EVERY)
    # So that what it takes to make the twins does not count.
    few = partial(run_many, [inst] * WIDEST, handle[:EVERY], wrench=wrench[:EVERY], every=EVERY)

    def together() -> float:
        return WIDEST * (t.size - EVERY) / (timeit(many, number=1) - timeit(few, number=1))

    peers = {"as exported": True, "handle held, all else off": False}
    peer = partial(chain_dynamics.steps_per_second, smooth, [0.3, 0.2, 0, 0, 0, 0], time_step=TIME_STEP, seconds=0.2)
    ours, side_by_side, *theirs = in_turns(
        ROUNDS, rate(t.size, run), together, *(partial(peer, as_exported=one) for one in peers.values())
    )
    print(f"{inst.name}, two axes that share tendons, {inst.friction.law} friction, one core:")
    said("cycles under a varying load, signals kept", ours, "M steps/s", TARGET_CHAIN_STEPS / 1e6)
    said(f"{WIDEST} twins together", side_by_side, "M steps/s")
    for name, steps in zip(peers, theirs, strict=True):
        times_faster(f"MuJoCo, {name}, alone", ours, steps)
        times_faster(f"MuJoCo, {name}, together", side_by_side, steps, TARGET_CHAIN_RATIO)


def peak() -> int:
    """Peak resident memory of this process, bytes; getrusage would count the parent's."""
    status = Path("/proc/self/status").read_text("ascii")
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


def many(inst: Instrument, runs: int) -> None:
    """The experiment of Fig. 15 over and over, friction varied: 20 s each, the weight hung on after 10 s."""
    steps = round(20 / TIME_STEP)
    weight = np.where(np.arange(steps) * TIME_STEP >= 10, WEIGHT, 0.0)
    handles = [float(tn.statics.handle_angle(inst, np.radians(angle))) for angle in OUTPUTS]
    random = np.random.default_rng(15)
    vertex, sheath = random.uniform(0, 0.4, (2, runs))
    # Each state is one row of commands, shared by the runs that hold it: commands per run would take 19 GB.
    tn.set_threads(os.cpu_count() or 1)
    Twin(inst).run(np.zeros(1000))
    base = peak()
    spent, kept, lost, done, shift = 0.0, 0, 0, 0, []
    started = time.perf_counter()
    for state, handle in enumerate(handles):
        command = handle * np.minimum(1, np.arange(1, steps + 1) * TIME_STEP / 2)
        mine = np.arange(state, runs, len(handles))
        for at in range(0, mine.size, CHUNK):
            chosen = mine[at : at + CHUNK]
            vary = {"friction.vertex_coefficient": vertex[chosen], "friction.sheath_coefficient": sheath[chosen]}
            start = time.perf_counter()
            batch = run_many(inst, command, weight=weight, vary=vary, seeds=chosen, signals=SIGNALS, every=EVERY)
            spent += time.perf_counter() - start
            kept += sum(batch[name].nbytes for name in SIGNALS)
            lost += int((batch.status != 0).sum())
            tip = np.degrees(batch["output_angle"])
            shift.append(tip[:, -1] - tip[:, tip.shape[1] // 2 - 1])
            done += chosen.size
            print(f"\r  {done} of {runs} runs, {time.perf_counter() - started:.0f} s", end="", file=sys.stderr)
    print(file=sys.stderr)
    shifts = np.concatenate(shift)
    simulated = 20.0 * runs
    print(
        f"  {runs} runs of 20 s on {tn.threads.threads()} cores: {simulated / spent:.3g} simulated s/s, "
        f"{runs * steps / spent / 1e6:.2f} M steps/s; {lost} lost; "
        f"the weight shifts the tip by {shifts.min():.1f} to {shifts.max():.1f} deg"
    )
    grown, together = peak() - base, min(mine.size, CHUNK)
    print(f"  memory a run: {kept / runs / 1e3:.1f} kB kept of {len(SIGNALS)} signals at {1 / TIME_STEP / EVERY:g} Hz")
    print(f"  peak memory grew by {grown / 1e6:.1f} MB: {grown / together / 1e3:.1f} kB a run of {together} at a time")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=int(os.environ.get("RUNS", RUNS)), help="runs of Fig. 15")
    parser.add_argument("--only-lanes", action="store_true", help="twins side by side in vectors")
    parser.add_argument("--instructions", action="store_true", help="instructions of a step, by valgrind")
    parser.add_argument("--only-steps", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--only-many", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    scaled = tn.load("scaled-up")
    real = tn.load("real-size").axis("yaw")
    if arguments.only_steps:
        name, most_lanes, steps = arguments.only_steps
        advance, _ = stepping(tn.load(name), int(most_lanes), int(steps))
        subprocess.run(["callgrind_control", "-i", "on", str(os.getpid())], check=True, stdout=subprocess.DEVNULL)
        advance()
        return
    if arguments.instructions:
        instructions(scaled)
        return
    if arguments.only_lanes:
        for inst in (scaled, real):
            lanes(inst)
        return
    if arguments.only_many:
        many(scaled, arguments.runs)
        return
    for inst in (scaled, real):
        single(inst)
    for inst in (scaled, real):
        lanes(inst)
    two_axes()
    print(f"many runs, {os.cpu_count()} cores:", flush=True)
    # In a process of its own, whose peak memory is its own.
    subprocess.run([sys.executable, __file__, "--only-many", "--runs", str(arguments.runs)], check=True)


if __name__ == "__main__":
    main()
