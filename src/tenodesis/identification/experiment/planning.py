"""Planning an experiment: the protocol after which the wanted parameters are known best."""

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple, get_args

import numpy as np
from scipy import special

from tenodesis import simulate
from tenodesis.errors import IdentificationError
from tenodesis.identification import identifiability
from tenodesis.identification.differences import scales
from tenodesis.identification.experiment import candidates as blocks
from tenodesis.identification.experiment.baselines import baselines
from tenodesis.identification.experiment.bench import Bench, UnfitError
from tenodesis.identification.experiment.candidates import Candidate, Phase
from tenodesis.identification.experiment.choice import Criterion, CriterionName, choose
from tenodesis.identification.experiment.information import Information
from tenodesis.identification.experiment.text import to_text
from tenodesis.identification.models.twin import TwinProblem
from tenodesis.identification.problem import Parameter
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.simulate import Protocol
from tenodesis.threads import threads

DURATION = 30.0
LONGEST = 600.0
"""Longest protocol that is planned, s."""
WANTED = ("friction", "stiffness", "pretension")
"""Groups that are wanted unless told, where the model has them."""
OPTIMISTIC = (
    "Predicted intervals know of the sensors' noise and rounding alone: they are the least that a bench can hope for. "
    "What the model leaves out, its longer time steps, loads that are not known exactly and an instrument that is not "
    "what its file says make them wider."
)

_HELD = {"friction.sheath_bend": "friction.sheath_coefficient"}
"""What is held unless wanted, since it acts only in a product with another."""
HALF = float(special.ndtri(0.975))
"""Half a 95 % interval, in standard deviations."""


class Block(NamedTuple):
    """A part of the proposed protocol: what it is, when it begins and how long it lasts, s."""

    candidate: Candidate
    begins: float
    seconds: float


@dataclass(frozen=True)
class Prediction:
    """What a protocol would tell."""

    name: str
    seconds: float
    std: Mapping[str, float]
    """Standard deviation of every open parameter with all of them open, SI; infinite where nothing depends on it."""
    objective: float
    """The criterion, in natural logarithms."""


@dataclass(frozen=True)
class Plan:
    """A proposed protocol and what it would tell."""

    inst: Instrument
    law: str
    distal_encoder: bool
    duration: float
    criterion: CriterionName
    forces: tuple[float, ...]
    parameters: tuple[Parameter, ...]
    wanted: tuple[str, ...]
    open: tuple[str, ...]
    """Parameters that the predictions take for unknown, the wanted among them."""
    held: tuple[str, ...]
    protocol: Protocol
    blocks: tuple[Block, ...]
    run: Run
    """What the twin does in it."""
    proposed: Prediction
    baselines: tuple[Prediction, ...]
    growth: tuple[Mapping[str, float], ...]
    """Standard deviation of every open parameter after each block."""
    untold: Mapping[str, str]
    """Why no candidate tells them, by the names of parameters."""
    left_out: Mapping[str, str]
    """Why candidates were left out, by name."""
    warnings: tuple[str, ...]

    @property
    def interval_95(self) -> dict[str, tuple[float, float]]:
        """Predicted 95 % intervals about the file's values, within the bounds, with all of them open, SI."""
        by_name = {one.name: one for one in self.parameters}
        return {
            name: (
                max(by_name[name].lower, by_name[name].start - HALF * std),
                min(by_name[name].upper, by_name[name].start + HALF * std),
            )
            for name, std in self.proposed.std.items()
        }

    def told(self, name: str) -> bool:
        """Return whether the protocol is predicted to tell a parameter, by the rule that fits are judged by."""
        partner = {other: held for held, other in _HELD.items()}.get(name)
        if name in self.untold and partner not in self.held:
            return False
        one = next(one for one in self.parameters if one.name == name)
        scale = float(scales([one], np.array([one.start]))[0])
        return self.proposed.std[name] < identifiability.TOLD * scale


def plan(
    inst: Instrument,
    want: Sequence[str] | None = None,
    *,
    duration: float = DURATION,
    distal_encoder: bool = True,
    forces: Sequence[float] | None = None,
    law: str | None = None,
    criterion: CriterionName = "D",
    progress: Callable[[int, int], None] | None = None,
) -> Plan:
    """Propose the bench protocol after which the wanted parameters are known best, and predict how well.

    The design is local: derivatives are taken at the file's values.

    Parameters
    ----------
    inst
        The instrument; of two axes the first.
    want
        Names of parameters or groups; friction, stiffness and pretension unless told.
    duration
        How long the protocol may last, s.
    distal_encoder
        Whether the bench has one.
    forces
        Known forces at the tip that the bench has, N; none if empty; unless told, shares of the slack limit.
    law
        Friction law; the instrument's unless told.
    criterion
        D for the smallest confidence region, A for the smallest sum of variances.
    progress
        Told how much is done of how much.

    Raises
    ------
    IdentificationError
        The request is not valid, or nothing that tells the wanted parameters fits into the duration.
    """
    inst = inst.axis(inst.axes[0]) if inst.axes[1:] else inst
    _check(duration, criterion)
    bench = Bench(inst, law or inst.friction.law, distal_encoder=distal_encoder)
    wanted = _wanted(bench, want)
    free, held = _free(bench, wanted)
    measure = Criterion(criterion, free, wanted)
    given = blocks.loads(bench.inst, forces)
    offered = blocks.candidates(bench.inst, given)
    compared = baselines(bench.inst, _of_paper(bench.inst, given), duration)
    report = _Progress(progress, len(offered) + len(compared) + _ORDERS)

    tried, left_out = _tried(bench, offered, report)
    if not tried:
        reasons = "; ".join(dict.fromkeys(left_out.values()))
        raise IdentificationError(f"{inst.name} can run none of the candidates: {reasons}.")
    everything = sum((one.told for one in tried[1:]), tried[0].told)
    best = _best(bench, tried, duration=duration, measure=measure, left_out=left_out, report=report)
    names = [one.name for one in bench.parameters]
    predictions, skipped = [], []
    for name, phases in compared.items():
        try:
            run = bench.run(phases)
        except UnfitError as problem:
            left_out[name] = str(problem)
            skipped.append(f"Not compared with {name}: {problem}.")
        else:
            (told,) = bench.tells(run)[1]
            predictions.append(_prediction(bench, name, run, told, free=free, measure=measure))
        report.step()
    ends = [*(one.begins + one.seconds for one in best.blocks[:-1]), math.inf]
    fitted, grown = bench.tells(best.run, ends)
    proposed = _prediction(bench, "the proposed protocol", best.run, grown[-1], free=free, measure=measure)
    untold = _untold(bench, fitted, everything, given)
    found = Plan(
        inst=bench.inst,
        law=bench.law,
        distal_encoder=distal_encoder,
        duration=duration,
        criterion=criterion,
        forces=given,
        parameters=bench.parameters,
        wanted=tuple(names[one] for one in wanted),
        open=tuple(names[one] for one in free),
        held=tuple(names[one] for one in held),
        protocol=best.protocol,
        blocks=best.blocks,
        run=best.run,
        proposed=proposed,
        baselines=tuple(predictions),
        growth=tuple(_std(bench, one, free) for one in grown),
        untold=untold,
        left_out=left_out,
        warnings=(),
    )
    return replace(found, warnings=(*_warnings(found), *skipped))


class _Tried(NamedTuple):
    candidate: Candidate
    seconds: float
    told: Information


class _Whole(NamedTuple):
    """A whole protocol as it was tried."""

    protocol: Protocol
    blocks: tuple[Block, ...]
    run: Run
    told: Information


class _Progress:
    def __init__(self, told: Callable[[int, int], None] | None, whole: int) -> None:
        self._told, self._whole, self._done = told, whole, 0

    def step(self) -> None:
        self._done = min(self._done + 1, self._whole)
        if self._told is not None:
            self._told(self._done, self._whole)


def _check(duration: float, criterion: str) -> None:
    if not 0 < duration <= LONGEST:
        raise IdentificationError(f"duration is {duration:g} s; allowed is a time above 0 s and up to {LONGEST:g} s.")
    if criterion not in get_args(CriterionName):
        raise IdentificationError(f"criterion is {criterion!r}; allowed are {', '.join(get_args(CriterionName))}.")


def _wanted(bench: Bench, want: Sequence[str] | None) -> list[int]:
    """Return the indices of the parameters that names of parameters or groups stand for."""
    names = [one.name for one in bench.parameters]
    groups = bench.groups
    words = [group for group in WANTED if group in groups] if want is None else list(want)
    if not words:
        raise IdentificationError(f"want is empty; allowed are one or more of {', '.join([*groups, *names])}.")
    found: list[str] = []
    for word in words:
        if bench.law == "none" and word.startswith("friction"):
            raise IdentificationError(
                f"want names {word}, but {bench.inst.name} has no friction; allowed is an instrument with a table "
                'friction, a guess will do: law = "capstan", vertex_coefficient = 0.1.'
            )
        if word == "mismatch.output_encoder_offset" and not bench.distal_encoder:
            raise IdentificationError(f"want names {word}, but there is no distal encoder; allowed is a bench with it.")
        if word not in names and word not in groups:
            allowed = ", ".join([*groups, *names])
            raise IdentificationError(f"want names {word!r}, which this bench does not have; allowed are {allowed}.")
        found += groups.get(word, (word,))
    return [names.index(name) for name in dict.fromkeys(found)]


def _free(bench: Bench, wanted: Sequence[int]) -> tuple[list[int], list[int]]:
    """Return the indices of the parameters that are open, and of those held since they act only in a product."""
    names = [one.name for one in bench.parameters]
    held = [names.index(name) for name in _HELD if name in names and names.index(name) not in wanted]
    return [index for index in range(len(names)) if index not in held], held


def _of_paper(inst: Instrument, forces: Sequence[float]) -> tuple[float, ...]:
    """Return the loads of Fig. 14, or those of the bench where the file has none; none without a load rig."""
    return inst.conditions.forces or tuple(forces[:3]) if forces else ()


def _tried(bench: Bench, offered: Sequence[Candidate], report: _Progress) -> tuple[list[_Tried], dict[str, str]]:
    """Return what each candidate tells by itself, and why others cannot be run."""

    def one(candidate: Candidate) -> _Tried | str:
        try:
            run = bench.run(candidate.phases)
        except UnfitError as problem:
            return str(problem)
        (told,) = bench.tells(run)[1]
        return _Tried(candidate, float(run.time[-1]), told)

    _ = bench.values, bench.scale
    tried, left_out = [], {}
    with ThreadPoolExecutor(threads()) as pool:
        for candidate, found in zip(offered, pool.map(one, offered), strict=True):
            if isinstance(found, str):
                left_out[candidate.name] = found
            else:
                tried.append(found)
            report.step()
    return tried, left_out


_ORDERS = 3
"""Whole protocols that are tried."""
_REPEATS = 2
"""How often a candidate may be taken where there is time for others: what the model lacks comes again with it."""


def _best(
    bench: Bench,
    tried: Sequence[_Tried],
    *,
    duration: float,
    measure: Criterion,
    left_out: dict[str, str],
    report: _Progress,
) -> _Whole:
    """Return the best of several whole protocols, history between their blocks included.

    A block that the whole cannot be run with is left out, and the choice made again.
    """
    pool, reason = list(tried), ""
    while True:
        seconds = [one.seconds for one in pool]
        most = max(_REPEATS, math.ceil(_REPEATS * duration / sum(seconds)))
        chosen = choose([one.told for one in pool], seconds, duration, measure, most=most)
        if not chosen:
            raise IdentificationError(
                f"duration is {duration:g} s, too short: the shortest of the candidates takes {min(seconds):.3g} s; "
                f"allowed is at least that, and {DURATION:g} s is usual."
            )
        wholes = []
        for order in _orders(chosen):
            try:
                wholes.append(_whole(bench, [pool[place] for place in order]))
            except UnfitError as problem:
                reason = str(problem)
            report.step()
        if wholes:
            return min(wholes, key=lambda one: measure.one(one.told))
        gone = max(chosen, key=lambda place: len(pool[place].candidate.phases))
        left_out[pool[gone].candidate.name] = f"not within the whole protocol: {reason}"
        del pool[gone]
        if not pool:
            raise IdentificationError(f"{bench.inst.name} can run no protocol of the candidates: {reason}.")


def _orders(chosen: Sequence[int]) -> list[list[int]]:
    """Return orders to try: as offered, in reverse, and shuffled; the same each time."""
    draw = np.random.default_rng(0)
    shuffled = [draw.permutation(np.array(chosen)).tolist() for _ in range(_ORDERS - 2)]
    orders = [list(chosen), list(reversed(chosen)), *shuffled]
    return [order for place, order in enumerate(orders) if order not in orders[:place]]


def _whole(bench: Bench, order: Sequence[_Tried]) -> _Whole:
    phases: list[Phase] = [phase for one in order for phase in one.candidate.phases]
    proposed = Protocol(
        name="identification",
        description=f"Proposed to identify {bench.inst.name}"[:200],
        phases=tuple(phases),
    )
    # What is tried is what the file will say, digits and all.
    protocol = simulate.parse(to_text(proposed))
    run = bench.run(protocol.phases)
    begins = np.concatenate([[0.0], np.cumsum([one.seconds for one in order])])
    parts = tuple(
        Block(one.candidate, float(begin), one.seconds) for one, begin in zip(order, begins[:-1], strict=True)
    )
    return _Whole(protocol, parts, run, bench.tells(run)[1][0])


def _prediction(
    bench: Bench, name: str, run: Run, told: Information, *, free: Sequence[int], measure: Criterion
) -> Prediction:
    return Prediction(
        name=name,
        seconds=float(run.time[-1]),
        std=_std(bench, told, free),
        objective=measure.one(told),
    )


def _std(bench: Bench, told: Information, free: Sequence[int]) -> dict[str, float]:
    """Return the standard deviation of parameters that are open together, SI."""
    std = told.of(free).spread().std * bench.scale[list(free)]
    return dict(zip((bench.parameters[index].name for index in free), std.tolist(), strict=True))


def _untold(bench: Bench, problem: TwinProblem, everything: Information, forces: Sequence[float]) -> dict[str, str]:
    """Return why all candidates together do not tell some parameters, by those parameters' names."""
    base = problem.residuals(bench.values, 0)

    def change(values: Array) -> float:
        return float(np.sum((problem.residuals(values, 0) - base) ** 2))

    indices = range(len(bench.parameters))
    told = identifiability.examine(
        problem, indices, bench.values, scale=bench.scale, found=everything.spread(), change=change
    )
    why: dict[str, str] = {}
    for one in told.combinations:
        if len(one.names) == 1:
            sentence = f"No candidate tells {one.names[0]}: what the sensors read hardly depends on it."
        else:
            names = " and ".join([", ".join(one.names[:-1]), one.names[-1]])
            known = f"only {one.known} acts" if one.known else "they change what the sensors read in the same way"
            sentence = f"No candidate tells {names} apart: {known}."
        reason = _reason(bench, problem, one.names)
        why |= dict.fromkeys(one.names, f"{sentence} {reason}" if reason else sentence)
    for name, fine in told.identifiable.items():
        if not fine and name not in why:
            reason = _reason(bench, problem, (name,))
            sentence = f"No candidate tells {name}: it leans on several others."
            why[name] = f"{sentence} {reason}" if reason else sentence
    if not forces and bench.inst.joint_type != "continuum":
        # A continuum's backbone is a known force.
        sentence = (
            f"No candidate tells {', '.join(_SCALING)} apart: without a known force at the tip all tensions scale "
            "together, but for the tip's swing, whose inertia is held at the file's. Put known loads on the tip, or "
            "hold the gains at a calibration's."
        )
        why |= dict.fromkeys(_SCALING, sentence)
    return why


def _reason(bench: Bench, problem: TwinProblem, names: Sequence[str]) -> str | None:
    """Return what is behind it that some parameters cannot be told, or what would tell them."""
    if "handle_length_share" in names and bench.law == "none":
        return "Without friction the tension is the same all along a tendon."
    if "friction.sheath_coefficient" in names and not bench.inst.friction.sheath_bend:
        return "The sheath of the file has no bend: give its bend, measured."
    if not bench.distal_encoder and any(name.startswith(("mismatch.load_cell", "stiffness")) for name in names):
        return "A distal encoder would, or holding the load cells' gains and biases at a calibration's."
    return problem.advice(names)


_SCALING = (
    "stiffness_ratio",
    "pretension_ratio",
    "mismatch.load_cell_gain.agonist",
    "mismatch.load_cell_gain.antagonist",
)
"""What scales together where no force is known."""


def _warnings(found: Plan) -> tuple[str, ...]:
    """Return what is to be borne in mind of a plan."""
    values = {one.name: one for one in found.parameters}
    out = [
        f"{name} is held at the file's {math.degrees(values[name].start):.4g} deg: only its product with "
        f"{_HELD[name]} acts, which errs by the share by which the bend does."
        for name in found.held
    ]
    for name in found.wanted:
        if not found.told(name) and name not in found.untold:
            out.append(
                f"{name} is not told by the proposed protocol within {found.duration:g} s, but candidates could: "
                "allow a longer duration, or want less."
            )
    weak = [name for name in found.wanted if name in _COEFFICIENTS and not values[name].start]
    if weak:
        out.append(
            f"{' and '.join(weak)} {'is' if len(weak) == 1 else 'are'} 0 in the file, where the plan takes the "
            "derivatives: give a guess, 0.1 will do."
        )
    worse = [
        (one.name, name)
        for one in found.baselines
        for name in found.wanted
        if one.std[name] < found.proposed.std[name] and name not in found.untold
    ]
    for name in dict.fromkeys(name for _, name in worse):
        better = " and ".join(baseline for baseline, told in worse if told == name)
        out.append(f"{name} would be known better by {better}, the others less.")
    return tuple(out)


_COEFFICIENTS = ("friction.vertex_coefficient", "friction.sheath_coefficient")
