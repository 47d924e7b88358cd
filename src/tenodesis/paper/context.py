"""What the sections of the report work on, and the results they leave."""

from dataclasses import dataclass, field

from tenodesis.instrument import Instrument
from tenodesis.report.content import Published, Result
from tenodesis.simulate import Protocol


@dataclass(frozen=True)
class Session:
    """A protocol run on the twin of an instrument, so that it can be run again and recorded."""

    inst: Instrument
    protocol: Protocol
    seed: int


@dataclass
class Context:
    """What the sections work on, and the results they leave."""

    inst: Instrument
    scaled: Instrument | None
    is_paper: bool
    """Whether both instruments are the paper's own, so that its printed numbers apply."""
    results: dict[str, Result] = field(default_factory=dict)
    recordings: dict[str, Session] = field(default_factory=dict)
    """What the twin did, to be recorded, by name of the file."""

    @property
    def tested(self) -> Instrument:
        """The instrument that the experiments are done on, one axis: in the paper's report its scale model."""
        inst = self.scaled if self.is_paper and self.scaled is not None else self.inst
        return inst if len(inst.axes) == 1 else inst.axis(inst.axes[0])

    def figure_of(self, name: str) -> str:
        """Return how a caption refers to a figure of the paper."""
        return f"paper: {name}" if self.is_paper else f"as {name} of the paper"

    def add(self, key: str, value: float, unit: str, description: str, published: Published | None = None) -> float:
        """Record a result under a new key and return its value."""
        if key in self.results:
            raise KeyError(f"result {key} is recorded twice")
        self.results[key] = Result(key, float(value), unit, description, published if self.is_paper else None)
        return float(value)
