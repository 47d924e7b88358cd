"""A planned experiment: its protocol, the predicted intervals, and the text of its protocol file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tomli_w
from scipy import special

from tenodesis.identification import identifiability
from tenodesis.identification.differences import scales
from tenodesis.identification.experiment.candidates import Candidate
from tenodesis.identification.experiment.choice import CriterionName
from tenodesis.identification.problem import Parameter
from tenodesis.instrument import ShortForm
from tenodesis.instrument.text import readable, with_units
from tenodesis.run import Run
from tenodesis.simulate import Protocol
from tenodesis.units import READABLE

OPTIMISTIC = (
    "Predicted intervals account for the sensors' noise and rounding alone: they are the best that a bench can reach. "
    "Effects beyond the model, its longer time steps, inaccurate loads and an instrument that differs from its file "
    "make them wider."
)

HELD_WITH = {"friction.sheath_bend": "friction.sheath_coefficient"}
"""Parameters that are held unless wanted, since they act only in a product with another."""
HALF = float(special.ndtri(0.975))
"""Half a 95 % interval, in standard deviations."""
_UNITS = {si: unit for si, unit in READABLE.items() if si != "s"}


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
class Plan:
    """A proposed protocol with its predictions."""

    inst: ShortForm
    law: str
    distal_encoder: bool
    duration: float
    criterion: CriterionName
    forces: tuple[float, ...]
    parameters: tuple[Parameter, ...]
    wanted: tuple[str, ...]
    open: tuple[str, ...]
    """Free parameters in the predictions, including the wanted parameters."""
    held: tuple[str, ...]
    protocol: Protocol
    blocks: tuple[Block, ...]
    run: Run
    """What the twin does in it."""
    proposed: Prediction
    baselines: tuple[Prediction, ...]
    growth: tuple[Mapping[str, float], ...]
    """Standard deviation of every open parameter after each block."""
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
        scale = float(scales([one], np.array([one.start]))[0])
        return self.proposed.std[name] < identifiability.IDENTIFIABLE_SHARE * scale


def to_text(protocol: Protocol, comment: str = "") -> str:
    """Return the text of a protocol file, with a comment at its head."""
    phases = [{"kind": phase.kind} | with_units(phase, unset=False) for phase in protocol.phases]
    values = with_units(protocol, unset=False) | {"phases": readable(phases, _UNITS)}
    head = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    return f"{head}\n{tomli_w.dumps(values)}" if head else tomli_w.dumps(values)
