"""What all parts of a protocol file have in common."""

from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, ValidationError

from tenodesis.errors import ArgumentError, ProtocolError
from tenodesis.toml import validated

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)


class _Sentences(ModelMetaclass):
    """Models whose errors are sentences in Python as well: files are read without a call of the class."""

    def __call__(self, *arguments: Any, **values: Any) -> Any:
        try:
            return super().__call__(*arguments, **values)
        except ValidationError:
            pass
        model: Any = self
        return validated(model, values, ProtocolError, self.__name__, entries={"phases": "phase"})


class ProtocolModel(BaseModel, metaclass=_Sentences):
    """Part of a protocol file: immutable, and unknown keys are errors.

    Raises ProtocolError if a value is not valid.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True)


def check_choice(model: BaseModel, *keys: str, required: bool = True) -> None:
    """Raise ValueError unless exactly one of these keys is given, or at most one if none is required."""
    given = [key for key in keys if getattr(model, key) is not None]
    if len(given) > 1:
        raise ArgumentError(f"{_listed(given)} are given; give only one of them", key=given[0])
    if required and not given:
        raise ArgumentError(f"none of {_listed(keys)} is given; give exactly one of them", key=keys[0])


def _listed(keys: list[str] | tuple[str, ...]) -> str:
    return ", ".join(keys[:-1]) + f" and {keys[-1]}"
