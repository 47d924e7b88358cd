"""Tolerance files: the keys that vary, by how much, and the source of each value."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from tenodesis.errors import StudyError
from tenodesis.instrument import Name
from tenodesis.toml import FileTable, parse_toml, read_text, validated

InstrumentName: TypeAlias = Literal["scaled-up", "real-size"]
DistributionName: TypeAlias = Literal["uniform", "triangular", "normal"]

_WIDTH_OF: dict[DistributionName, str] = {
    "uniform": "half_width",
    "triangular": "half_width",
    "normal": "standard_deviation",
}


def _written(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError('it must be text like "0.1 mm" or "5 %", or a number where the key has no unit')
    return value


Width = Annotated[str | float, BeforeValidator(_written)]


class Tolerance(FileTable):
    """Tolerance of a value of an instrument file."""

    key: str = Field(description="Key of the instrument file; within a table with a dot, friction.vertex_coefficient")
    distribution: DistributionName = Field(description="uniform, triangular or normal, about the file's value")
    half_width: Width | None = Field(
        default=None, description='Of a uniform or triangular distribution: "0.1 mm", or "5 %" of the file\'s value'
    )
    standard_deviation: Width | None = Field(default=None, description="Of a normal distribution, written alike")
    instrument: InstrumentName = Field(default="scaled-up", description="The instrument that it applies to")
    source: str = Field(default="", max_length=200, description="Source of the tolerance")

    @property
    def width_key(self) -> str:
        """Key of the distribution's width."""
        return _WIDTH_OF[self.distribution]

    @property
    def width(self) -> str | float:
        """The width as written."""
        width = getattr(self, self.width_key)
        assert width is not None
        return width  # type: ignore[no-any-return]

    @model_validator(mode="after")
    def _one_width(self) -> Self:
        for key in ("half_width", "standard_deviation"):
            if key == self.width_key and getattr(self, key) is None:
                raise ValueError(f"{key} of {self.key} is missing; a {self.distribution} distribution needs it")
            if key != self.width_key and getattr(self, key) is not None:
                raise ValueError(
                    f"{key} of {self.key} is given, which a {self.distribution} distribution does not have; "
                    f"it has {self.width_key}"
                )
        return self


class Tolerances(FileTable):
    """The tolerances of a study."""

    name: Name = Field(default="tolerances", description="Name in the report")
    description: str = Field(default="", max_length=200, description="One line about them")
    parameters: tuple[Tolerance, ...] = Field(max_length=50, description="One table per key that varies")

    @model_validator(mode="after")
    def _some_and_each_once(self) -> Self:
        if not self.parameters:
            raise ValueError("parameters is empty; it must have at least one table [[parameters]]")
        seen: set[tuple[str, str]] = set()
        for one in self.parameters:
            if (one.key, one.instrument) in seen:
                raise ValueError(f"{one.key} of {one.instrument} is given twice; it must be given once")
            seen.add((one.key, one.instrument))
        return self


def load(path: str | Path) -> Tolerances:
    """Read a tolerance file; raises StudyError if there is none, it cannot be read, or it is not valid."""
    return parse(read_text(Path(path), StudyError), str(path))


def parse(text: str, source: str = "tolerances") -> Tolerances:
    """Read tolerances from the text of a tolerance file.

    Raises StudyError, whose message starts with `source`, if the text is not TOML or not valid.
    """
    values = parse_toml(text, StudyError, source, "tolerances")
    if not values.get("parameters"):
        raise StudyError(key=f"{source}: parameters", value=[], allowed="one table [[parameters]] or more")
    return validated(Tolerances, values, StudyError, source, entries={"parameters": "parameter"})


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of tolerance files, for editors that complete and check TOML."""
    schema = Tolerances.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "Tenodesis tolerances"}
