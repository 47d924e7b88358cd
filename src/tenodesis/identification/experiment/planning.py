"""Planning an experiment: the protocol after which the wanted parameters are known best."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import NamedTuple, get_args

import numpy as np
from scipy import special

from tenodesis.errors import IdentificationError
from tenodesis.identification import identifiability
from tenodesis.identification.experiment.candidates import Candidate
from tenodesis.identification.experiment.information import Criterion, CriterionName, Information, choose
from tenodesis.identification.experiment.joints import JointExperiment
from tenodesis.identification.experiment.simulated import Experiment, InfeasibleProtocolError, SimulatedExperiment
from tenodesis.identification.problem import Parameter
from tenodesis.instrument import Instrument, expanded
from tenodesis.run import Run
from tenodesis.simulate import Protocol
from tenodesis.threads import thread_pool

OPTIMISTIC = SimulatedExperiment.caveat

HELD_WITH = {"friction.sheath_bend": "friction.sheath_coefficient"}
"""Parameters that are held unless wanted, since they act only in a product with another."""
HALF = float(special.ndtri(0.975))
"""Half a 95 % interval, in standard deviations."""


class Block(NamedTuple):
    """A block of the proposed protocol, when it begins and how long it lasts, s."""

    candidate: Candidate
    begins: float
    seconds: float


@dataclass(frozen=True)
class Prediction:
    """The uncertainty of parameters after a protocol."""

    name: str
    seconds: float
    std: Mapping[str, float]
    """Standard deviation of every open parameter with all of them open, SI; infinite where nothing depends on it."""
    objective: float
    """The criterion, in natural logarithms."""


@dataclass(frozen=True)
class ProposedProtocol:
    """A proposed protocol with its predictions."""

    inst: Instrument
    law: str
    caveat: str
    """What the predictions leave out."""
    distal_encoder: bool
    duration: float
    criterion: CriterionName
    forces: tuple[float, ...]
    parameters: tuple[Parameter, ...]
    wanted: tuple[str, ...]
    open: tuple[str, ...]
    """Free parameters in the predictions, including the wanted parameters."""
    held: tuple[str, ...]
    assumed: Mapping[str, float]
    """Values in place of those that the file lacks."""
    protocol: Protocol | None
    """None of motions that no protocol holds, which `run` has the commands of."""
    blocks: tuple[Block, ...]
    run: Run
    """What the twin does in it."""
    proposed: Prediction
    baselines: tuple[Prediction, ...]
    growth: tuple[Mapping[str, float], ...]
    """Standard deviation of every open parameter after each block; of several joints at the end alone."""
    unidentifiable: Mapping[str, str]
    """Why no candidate identifies them, by the names of parameters."""
    left_out: Mapping[str, str]
    """Why candidates were left out, by name."""

    def __repr__(self) -> str:
        wanted = ", ".join(self.wanted)
        return f"<Plan for {self.inst.name!r}: {len(self.blocks)} blocks in {self.proposed.seconds:.4g} s for {wanted}>"

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

    def identifiable(self, name: str) -> bool:
        """Return whether a parameter is predicted to be identifiable, by the rule that fits are judged by."""
        partner = {other: held for held, other in HELD_WITH.items()}.get(name)
        if name in self.unidentifiable and partner not in self.held:
            return False
        one = next(one for one in self.parameters if one.name == name)
        return identifiability.is_identifiable(one, self.proposed.std[name])


DURATION = 30.0
LONGEST = 600.0
"""Longest protocol that is planned, s."""
WANTED = ("friction", "stiffness", "pretension")
"""Groups that are wanted by default, where the model has them."""


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
) -> ProposedProtocol:
    """Propose the bench protocol after which the wanted parameters are known best, and predict how well.

    The design is local: derivatives are taken at the file's values. Of two axes it is for the first; of an instrument
    that lists joints and tendons for all joints.

    Parameters
    ----------
    want
        Names of parameters or groups; friction, stiffness and pretension by default.
    duration
        How long the protocol may last, s.
    forces
        Known forces at the tip that the bench has, N; none if empty; by default shares of the slack limit. Of several
        joints the largest, 0.5 N by default.
    law
        Friction law; the instrument's by default.
    criterion
        D for the smallest confidence region, A for the smallest sum of variances.
    progress
        Called with how many of how many protocols are tried.

    Raises
    ------
    IdentificationError
        The request is not valid, or no candidate fits into the duration.
    """
    _check(duration, criterion)
    short = inst.short_form
    experiment: Experiment = (
        JointExperiment(expanded(inst), law, distal_encoder=distal_encoder, forces=forces)
        if short is None
        else SimulatedExperiment(short.planar[0], law, distal_encoder=distal_encoder, forces=forces)
    )
    wanted = _wanted(experiment, want)
    free, held = _free(experiment, wanted)
    measure = Criterion(criterion, free, wanted)
    offered, compared = experiment.candidates, experiment.baselines(duration)
    done, total = count(1), len(offered) + len(compared) + experiment.orders

    def step() -> None:
        if progress is not None:
            progress(min(next(done), total), total)

    def predicted(name: str, run: Run, found: Information) -> Prediction:
        return Prediction(name, float(run.time[-1]), _std(experiment, found, free), measure.one(found))

    tried, left_out = _tried(experiment, offered, step)
    if not tried:
        reasons = "; ".join(dict.fromkeys(left_out.values()))
        raise IdentificationError(
            f"{inst.name} can run none of the candidates: {reasons}.", key="inst", value=inst.name
        )
    everything = sum((one.information for one in tried[1:]), tried[0].information)
    best = _best(experiment, tried, duration=duration, measure=measure, left_out=left_out, step=step)
    names = [one.name for one in experiment.parameters]
    predictions, skipped = [], []
    for name, phases in compared.items():
        try:
            run = experiment.run(phases)
        except InfeasibleProtocolError as problem:
            left_out[name] = str(problem)
            skipped.append(f"Not compared with {name}: {problem}.")
        else:
            (information,) = experiment.prediction(run)[1]
            predictions.append(predicted(name, run, information))
        step()
    ends = [*(one.begins + one.seconds for one in best.blocks[:-1]), math.inf]
    fitted, grown = experiment.prediction(best.run, ends)
    found = ProposedProtocol(
        inst=experiment.inst,
        law=experiment.law,
        caveat=experiment.caveat,
        distal_encoder=distal_encoder,
        duration=duration,
        criterion=criterion,
        forces=experiment.forces,
        parameters=experiment.parameters,
        wanted=tuple(names[one] for one in wanted),
        open=tuple(names[one] for one in free),
        held=tuple(names[one] for one in held),
        assumed=experiment.assumed,
        protocol=best.protocol,
        blocks=best.blocks,
        run=best.run,
        proposed=predicted("the proposed protocol", best.run, grown[-1]),
        baselines=tuple(predictions),
        growth=tuple(_std(experiment, one, free) for one in grown),
        unidentifiable=experiment.unidentifiable(fitted, everything),
        left_out=left_out,
        warnings=(),
    )
    return replace(found, warnings=(*_warnings(found), *skipped))


class _TriedCandidate(NamedTuple):
    candidate: Candidate
    seconds: float
    information: Information


class _TriedProtocol(NamedTuple):
    """A protocol of several blocks with its evaluation."""

    protocol: Protocol | None
    blocks: tuple[Block, ...]
    run: Run
    information: Information


def _check(duration: float, criterion: str) -> None:
    if not 0 < duration <= LONGEST:
        raise IdentificationError(key="duration", value=duration, allowed=f"above 0 s and up to {LONGEST:g} s")
    if criterion not in get_args(CriterionName):
        raise IdentificationError(key="criterion", value=criterion, allowed=" or ".join(get_args(CriterionName)))


def _wanted(experiment: Experiment, want: Sequence[str] | None) -> list[int]:
    """Return the indices of the parameters that names of parameters or groups stand for."""
    names = [one.name for one in experiment.parameters]
    groups = experiment.groups
    words = [group for group in WANTED if group in groups] if want is None else list(want)
    if not words:
        raise IdentificationError(f"want is empty; it must name some of {', '.join([*groups, *names])}.", key="want")
    found: list[str] = []
    for word in words:
        if experiment.law == "none" and word.startswith("friction"):
            raise IdentificationError(
                f"want names {word}, but {experiment.inst.name} has no friction; it must have a table friction, "
                'for which a guess will do: law = "capstan", vertex_coefficient = 0.1.',
                key="want",
                value=word,
            )
        if word == "mismatch.output_encoder_offset" and not experiment.distal_encoder:
            raise IdentificationError(
                f"want names {word}, but there is no distal encoder; the bench must have one.", key="want", value=word
            )
        if word not in names and word not in groups:
            known = ", ".join([*groups, *names])
            raise IdentificationError(
                f"want names {word!r}, which is no parameter here; it must name some of {known}.",
                key="want",
                value=word,
            )
        found += groups.get(word, (word,))
    return [names.index(name) for name in dict.fromkeys(found)]


def _free(experiment: Experiment, wanted: Sequence[int]) -> tuple[list[int], list[int]]:
    """Return the indices of the parameters that are open, and of those held since they act only in a product."""
    names = [one.name for one in experiment.parameters]
    held = [names.index(name) for name in HELD_WITH if name in names and names.index(name) not in wanted]
    return [index for index in range(len(names)) if index not in held], held


def _tried(
    experiment: Experiment, offered: Sequence[Candidate], step: Callable[[], None]
) -> tuple[list[_TriedCandidate], dict[str, str]]:
    """Return the information of each candidate by itself, and why others cannot be run."""

    def one(candidate: Candidate) -> _TriedCandidate | str:
        try:
            run = experiment.run(candidate.phases)
        except InfeasibleProtocolError as problem:
            return str(problem)
        (information,) = experiment.information(run)[1]
        return _TriedCandidate(candidate, float(run.time[-1]), information)

    _ = experiment.values, experiment.scale
    tried, left_out = [], {}
    with thread_pool() as pool:
        for candidate, found in zip(offered, pool.map(one, offered), strict=True):
            if isinstance(found, str):
                left_out[candidate.name] = found
            else:
                tried.append(found)
            step()
    return tried, left_out


def _best(
    experiment: Experiment,
    tried: Sequence[_TriedCandidate],
    *,
    duration: float,
    measure: Criterion,
    left_out: dict[str, str],
    step: Callable[[], None],
) -> _TriedProtocol:
    """Return the best of several orders of the chosen blocks, each run as a protocol.

    A block with which no order can be run is left out, and the choice made again.
    """
    pool, reason = list(tried), ""
    while True:
        seconds = [one.seconds for one in pool]
        most = max(experiment.repeats, math.ceil(experiment.repeats * duration / sum(seconds)))
        chosen = choose([one.information for one in pool], seconds, duration, measure, most=most)
        if not chosen:
            raise IdentificationError(
                f"duration is {duration:g} s, too short: the shortest of the candidates takes {min(seconds):.3g} s; it "
                f"must be at least that, and {DURATION:g} s is usual.",
                key="duration",
                value=duration,
            )
        protocols = []
        for order in _orders(chosen, experiment.orders):
            try:
                protocols.append(_joined(experiment, [pool[place] for place in order]))
            except InfeasibleProtocolError as problem:
                reason = str(problem)
            step()
        if protocols:
            return min(protocols, key=lambda one: measure.one(one.information))
        gone = max(chosen, key=lambda place: len(pool[place].candidate.phases))
        left_out[pool[gone].candidate.name] = f"not together with the other blocks: {reason}"
        del pool[gone]
        if not pool:
            raise IdentificationError(
                f"{experiment.inst.name} can run no protocol of the candidates: {reason}.",
                key="inst",
                value=experiment.inst.name,
            )


def _joined(experiment: Experiment, order: Sequence[_TriedCandidate]) -> _TriedProtocol:
    protocol, run = experiment.joined([phase for one in order for phase in one.candidate.phases])
    begins = np.concatenate([[0.0], np.cumsum([one.seconds for one in order])[:-1]]).tolist()
    parts = tuple(Block(one.candidate, begin, one.seconds) for one, begin in zip(order, begins, strict=True))
    return _TriedProtocol(protocol, parts, run, experiment.information(run)[1][0])


def _orders(chosen: Sequence[int], count: int) -> list[list[int]]:
    """Return orders to try: as offered, in reverse, and shuffled; the same each time."""
    draw = np.random.default_rng(0)
    shuffled = [draw.permutation(np.array(chosen)).tolist() for _ in range(count - 2)]
    orders = [list(chosen), list(reversed(chosen)), *shuffled][:count]
    return [order for place, order in enumerate(orders) if order not in orders[:place]]


def _std(experiment: Experiment, information: Information, free: Sequence[int]) -> dict[str, float]:
    """Return the standard deviation of parameters that are open together, SI."""
    std = information.of(free).uncertainty().std * experiment.scale[list(free)]
    return dict(zip((experiment.parameters[index].name for index in free), std.tolist(), strict=True))


def _warnings(found: ProposedProtocol) -> tuple[str, ...]:
    """Return the caveats of a plan, a sentence each."""
    values = {one.name: one for one in found.parameters}
    out = [
        f"{name} is held at the file's {math.degrees(values[name].start):.4g} deg: only its product with "
        f"{HELD_WITH[name]} acts, which has the relative error of the bend."
        for name in found.held
    ]
    for name in found.wanted:
        if not found.identifiable(name) and name not in found.unidentifiable:
            out.append(
                f"{name} is not identifiable by the proposed protocol within {found.duration:g} s, but by candidates: "
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
        if one.std[name] < found.proposed.std[name] and name not in found.unidentifiable
    ]
    for name in dict.fromkeys(name for _, name in worse):
        better = " and ".join(baseline for baseline, better_known in worse if better_known == name)
        out.append(f"{name} would be known better by {better}, the others less.")
    return tuple(out)


_COEFFICIENTS = ("friction.vertex_coefficient", "friction.sheath_coefficient")
