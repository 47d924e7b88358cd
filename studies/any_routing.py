"""Observer and law for any routing: what is left in each joint under load, beside motors that follow their commands.

    python studies/any_routing.py --tool TOOL.json

Instruments whose tendons turn several joints, and of which jaws have tendons through the wrist, home, and are brought
to states over their range, by commands or by their handle; then a force comes at the tip, such as bends a joint by half
of what its pretension holds. Tendons have friction in their sheaths and at every bend, 0.7, 1 and 1.3 times what the
controller assumes. Errors are those of all that bends over the last tenth of a second, against the commands, or what
the handle asks for; beside them those of a rigid coupling matrix alone, and how much farther from its command any of
them is with the law than without: at the end, and ever since the force. The same again as calibrated: with constant
errors of load cells and lengths of tendons, drawn for each case with the deviations that the file states; and as
identified: on three instruments with such errors, of whose parameters and load cells the controller knows what
identification finds in a recording of 3 s with the joints' angles, at the end of which tendons are slack, before
friction changes. Last, the wrist moves while the jaws hold an object.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import coverage
import figures
import law
import numpy as np
from numpy.typing import NDArray

from tenodesis.control import JointController, JointEstimate, Request
from tenodesis.identification import fit, routing
from tenodesis.identification.problem import SensorError
from tenodesis.instrument import FullForm, expanded, from_dvrk
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column
from tenodesis.statics import unloaded_angle
from tenodesis.twin import Held, Twin

Array = NDArray[np.float64]

NAMES = ("needle-driver", "maryland-dissector", "two-segment-continuum", "hybrid-real-size", "hybrid-scaled-up")
DIRECTIONS = ((1, 0, 0), (0, -1, 0), (-0.7, 0.7, 0), (0.6, 0.5, -0.6))
COEFFICIENT, BEND = 0.1, np.radians(20)
"""Of friction, and of the sheath."""
SHARES = ((0, 0, 0), (0.3, 0.3, -0.3), (-0.6, 0.3, 0.3), (0.3, -0.6, 0.6), (0.6, 0.6, 0.6), (-0.6, -0.6, 0.3))
"""Of the range, by turns of what bends."""
MOST = np.radians(70)
CLOSINGS = (0.05, 0.1, 0.3, 0.6)
"""Of each jaw beyond straight, rad."""
RESUMED, HOMED, ARRIVED, LOADED, END, LAST, STEP = 2.1, 2.2, 1.0, 3.4, 6.2, 0.1, 5e-4  # s
CALIBRATIONS = ("exact", "as calibrated", "as identified")
IDENTIFIED = 77
"""Of the seeds of instruments that are identified."""
SLACK, SETTLED = 2.5, 0.9
"""Times what is wound to the pretension, that is let out; after how long joints have bent so far that all slips, s."""
MOVED = round((HOMED + 1.5) / STEP)
"""Step from which the wrist moves with an object."""
APART = round(0.02 / STEP)
"""Steps by which grips are compared at most: where the law turns a joint sooner, friction turns sooner, too."""


@cache
def tool(name: str, friction: float = 1.0) -> FullForm:
    """Return a shipped instrument, or that of a tool file, with friction so many times as strong as is assumed."""
    inst = from_dvrk(Path(name)) if name.endswith(".json") else expanded(name)
    own = dict.fromkeys(law.COEFFICIENTS, COEFFICIENT * friction)
    return inst.replace(friction={"law": "capstan", "sheath_bend": BEND, **own})


def bends_of(inst: FullForm, state: int) -> Array:
    """Return the angles of what bends in a state, rad; jaws cannot cross."""
    low, high = inst.bend_limits.T
    shares = np.resize(SHARES[state], len(low))
    angles = np.clip(np.where(shares > 0, shares * high, -shares * low), -MOST, MOST)
    if inst.grip is None or inst.grip_arms @ inst.bent(angles) >= 0:
        return angles
    of_jaws = np.array([bool(inst.grip_arms[places].any()) for places in inst.bends.values()])
    return np.where(of_jaws, -angles, angles)


def commanded(inst: FullForm, state: int) -> tuple[Array, Array]:
    """Return angles of the handle and those that they, or commands, ask of the joints in a state, rad."""
    if not inst.handle_joints:
        return np.zeros(0), inst.bent(bends_of(inst, state))
    ranges = np.array([joint.range for joint in inst.handle_joints])
    handle = np.resize(SHARES[state], len(ranges)) * ranges
    handle = np.where(triggers(inst), np.abs(handle), handle)
    return handle, np.asarray(unloaded_angle(inst, handle))


def triggers(inst: FullForm) -> NDArray[np.bool_]:
    """Return which joints of the handle have a single tendon, against a spring: it only pulls."""
    return np.asarray((inst.tendon_arms("handle") != 0).sum(axis=0) == 1)


def eased(start: float, span: float) -> Array:
    """Return a smooth way from 0 to 1, by step, as a column."""
    share = np.clip((np.arange(1, round(END / STEP) + 1) * STEP - start) / span, 0, 1)
    return np.asarray(share**2 * (3 - 2 * share))[:, np.newaxis]


def force_of(inst: FullForm) -> float:
    """Return the force across the tip that takes half of the moment that the pretension of a joint's tendons holds."""
    held = float(np.max(np.abs(inst.tendon_arms("tip")).T @ inst.pretensions))
    last = max(joint.end_effector_length or 0.0 for joint in inst.tip_joints)
    return held / 2 / (last + sum(joint.offset + joint.chord for joint in inst.tip_joints))


def drawn(inst: FullForm, random: np.random.Generator) -> tuple[FullForm, Array]:
    """Return an instrument with load cells as inexact as its file says, and what its tendons are too long, m."""
    offsets = [sensor.offset for sensor in inst.tension_sensors] * random.standard_normal(len(inst.tendons))
    tendons = [
        tendon.model_copy(update={"load_cell_bias": float(bias)})
        for tendon, bias in zip(inst.as_given("tendons"), offsets, strict=True)
    ]
    lengths = inst.control.reference_uncertainty * random.standard_normal(len(inst.tendons))
    return inst.replace(tendons=tendons), lengths


@cache
def identified(name: str, seed: int) -> tuple[FullForm, Array, FullForm]:
    """Return an instrument with errors, those of its load cells as identification leaves them, and its file.

    The errors of lengths, m, are between; the file has what was identified.
    """
    inst = tool(name)
    true, lengths = drawn(inst, np.random.default_rng([seed, IDENTIFIED]))
    slack = SLACK * float(np.max(inst.pretensions / inst.stiffnesses))
    run = coverage.excited(true, inst, seed, slack=slack, let_out=lengths)
    problem = routing.problem([routing.of_run(run, inst, settled=SETTLED)], [], law="capstan")
    found = fit(problem, train=[0], starts=1)
    # of a recording that the model does not explain no errors of load cells are known
    unknown = [SensorError(0.0, sensor.offset, "N") for sensor in inst.tension_sensors]
    errors = found.files[0].sensors
    cells = [errors.get(f"tension.{one.name}.offset", own) for one, own in zip(inst.tendons, unknown, strict=True)]
    tendons = [
        tendon.model_copy(update={"load_cell_bias": tendon.load_cell_bias - cell.value})
        for tendon, cell in zip(true.as_given("tendons"), cells, strict=True)
    ]
    offset = max(cell.std for cell in cells)
    fitted = problem.instrument(found.vector).as_given("tendons")
    # those in the file are what homing winds to
    wound = [one.model_copy(update={"pretension": own}) for one, own in zip(fitted, inst.pretensions, strict=True)]
    known = problem.instrument(found.vector).replace(tendons=wound, **{"sensors.load_cell_offset": offset})
    return true.replace(tendons=tendons), lengths, known


def run_of(
    name: str,
    friction: float,
    handle: Array,
    target: Array,
    *,
    compensates: bool,
    calibration: Sequence[int] = (),
    identification: int | None = None,
    seed: int = 1,
    **loads: Any,
) -> tuple[Run, JointEstimate, Array]:
    """Return a run, its estimates and the errors of what bends, deg; handle, target: rad, with a row per step.

    calibration, identification: seed of the errors that it has left; without a seed there are none.
    """
    inst, known = tool(name, friction), tool(name)
    if calibration:
        inst, loads["let_out"] = drawn(inst, np.random.default_rng(calibration))
    if identification is not None:
        left, loads["let_out"], known = identified(name, identification)
        inst = inst.replace(tendons=left.as_given("tendons"))
    controller = JointController(known, "joints" if compensates else "off")
    aims = {} if inst.handle_joints else {"target": target}
    request = np.zeros(len(target), dtype=int)
    if compensates:
        request[0], request[round(RESUMED / STEP)] = Request.HOME, Request.RESUME
    run = Twin(inst, seed=seed).run(handle, controller=controller, request=request, **aims, **loads)
    return run, controller.estimate, np.degrees(summed(inst, run["output_angle"] - target))


def summed(inst: FullForm, angles: Array) -> Array:
    """Return the angles of what bends, from those of joints."""
    return np.stack([angles[:, places].sum(axis=1) for places in inst.bends.values()], axis=1)


def trial(
    name: str, state: int, direction: tuple[float, float, float], friction: float, calibration: str
) -> dict[str, Any]:
    """Run a state under a force, by a rigid coupling alone and with the law: errors, deg.

    calibration: what has left errors.
    """
    inst = tool(name)
    way = eased(HOMED, ARRIVED)
    handle, target = (way * angles for angles in commanded(inst, state))
    wrench = eased(LOADED, 0.1) * np.array([*(force_of(inst) * np.asarray(direction)), 0, 0, 0])
    given: dict[str, Any] = {"wrench": wrench}
    if calibration == "as calibrated":
        given["calibration"] = (state, DIRECTIONS.index(tuple(direction)), law.ASSUMED.index(friction))
    elif calibration == "as identified":
        given["identification"] = law.ASSUMED.index(friction)
    _, _, alone = run_of(name, friction, handle, target, compensates=False, **given)
    run, estimate, with_law = run_of(name, friction, handle, target, compensates=True, **given)
    last = slice(-round(LAST / STEP), None)
    off = np.degrees(summed(inst, estimate.angle - run["output_angle"]))[last].mean(axis=0)
    sums = np.array([np.isin(np.arange(len(inst.tip_joints)), places) for places in inst.bends.values()], float)
    std = np.degrees(np.sqrt(np.diag(sums @ estimate.covariance[-1] @ sums.T)))
    farther = np.abs(with_law) - np.abs(alone)
    return {
        "alone": campaign.rms(alone[last]),
        "alone_worst": campaign.farthest(alone[last]),
        "law": campaign.rms(with_law[last]),
        "law_worst": campaign.farthest(with_law[last]),
        "farther": float(farther[last].mean(axis=0).max()),
        "meanwhile": float(farther[round(LOADED / STEP) :].max()),
        "estimate": campaign.rms(off),
        "normalised": campaign.rms(off / std),
    }


def grip_kept(name: str, closing: float, friction: float) -> dict[str, float]:
    """Return the grip on an object while the wrist moves, N, and bounds of that with the law over that by a coupling.

    closing: of each jaw, half of it before it touches, rad.
    """
    inst = tool(name)
    closed = inst.bent(np.zeros(len(inst.bends))) - closing * np.sign(inst.grip_arms)
    held = Held(opening=float(inst.grip_arms @ closed) / 2, stiffness=3e3, damping=1.0)
    moved = inst.bent(bends_of(inst, 1)) * (inst.grip_arms == 0)
    closes, moves = eased(HOMED, ARRIVED), eased(HOMED + 1.5, ARRIVED)
    target, handle = closes * closed + moves * moved, np.zeros((len(closes), 0))
    if inst.handle_joints:
        # The trigger draws what the closed jaws take.
        triggered = np.linalg.pinv(inst.tendon_arms("handle")) @ inst.tendon_arms("tip") @ closed
        handle = closes * triggered + moves * np.where(triggers(inst), 0, commanded(inst, 1)[0])

    def gripped(scale: float, *, compensates: bool) -> tuple[Array, JointEstimate]:
        run, estimate, _ = run_of(name, scale, handle, target, compensates=compensates, held=held, seed=2)
        return run["grip_force"][MOVED:].ravel(), estimate

    (free, _), (alone, _), (own, estimate) = (
        gripped(scale, compensates=compensates)
        for scale, compensates in ((0.0, False), (friction, False), (friction, True))
    )
    around = np.lib.stride_tricks.sliding_window_view(np.pad(alone, APART, mode="edge"), 2 * APART + 1)
    return {
        "free": float(free[-1]),
        "alone_least": float(alone.min()),
        "alone_most": float(alone.max()),
        "law_least": float(own.min()),
        "law_most": float(own.max()),
        "least": float((own / alone).min()),
        "most": float((own / alone).max()),
        "least_apart": float((own / around.min(axis=1)).min()),
        "most_apart": float((own / around.max(axis=1)).max()),
        "known": float(estimate.load_std[MOVED, -1]),
    }


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--name", choices=NAMES, action="append", help="by default all, without --tool")
    parser.add_argument("--tool", action="append", default=[], help="tool file of the da Vinci Research Kit")
    options = parser.parse_args()
    columns = [
        Column("coupling RMS", "alone", campaign.rms),
        Column("coupling worst", "alone_worst", np.max),
        Column("law RMS", "law", campaign.rms),
        Column("law worst", "law_worst", np.max),
        Column("farther", "farther", np.max),
        Column("meanwhile", "meanwhile", np.max),
        Column("estimate RMS", "estimate", campaign.rms),
        Column("normalised, 1", "normalised", campaign.rms),
    ]
    grips = [
        Column("without friction, N", "free", np.mean),
        Column("coupling least, N", "alone_least", np.min),
        Column("coupling most, N", "alone_most", np.max),
        Column("law least, N", "law_least", np.min),
        Column("law most, N", "law_most", np.max),
        Column("least over coupling, 1", "least", np.min),
        Column("most over it, 1", "most", np.max),
        Column("least within 20 ms, 1", "least_apart", np.min),
        Column("most within 20 ms, 1", "most_apart", np.max),
        Column("known to, N", "known", np.mean),
    ]
    for name in [*(options.name or (() if options.tool else NAMES)), *options.tool]:
        axes = {"name": [name], "state": range(len(SHARES)), "direction": DIRECTIONS, "friction": law.ASSUMED}
        cases = campaign.cases(**axes, calibration=CALIBRATIONS)
        by = campaign.run(trial, cases, Path(name).stem, results=options.results).by("calibration")
        print(f"{Path(name).stem}, {force_of(tool(name)):.3g} N in {len(DIRECTIONS)} directions")
        groups = by["exact"].by("friction") | {"all": by["exact"]} | {one: by[one] for one in CALIBRATIONS[1:]}
        law.show(options, f"any_routing_{figures.slug(Path(name).stem)}", groups, columns)
        if tool(name).grip is not None:
            axes = {"name": [name], "closing": CLOSINGS, "friction": law.ASSUMED}
            rows = campaign.run(grip_kept, campaign.cases(**axes), "grip")
            law.show(options, f"any_routing_grip_{figures.slug(Path(name).stem)}", rows.by("closing"), grips)
    print("targets 0.3 RMS, 0.7 worst, farther by 0.3 at most, normalised 0.7 to 1.5; grip 0.95 to 1.05")


if __name__ == "__main__":
    main()
