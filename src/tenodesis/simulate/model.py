"""What all parts of a protocol file have in common."""

from pydantic import BaseModel, ConfigDict


class ProtocolModel(BaseModel):
    """Part of a protocol file: immutable, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True)


def check_choice(model: BaseModel, *keys: str, required: bool = True) -> None:
    """Raise ValueError unless exactly one of these keys is given, or at most one if none is required."""
    given = [key for key in keys if getattr(model, key) is not None]
    if len(given) > 1:
        raise ValueError(f"{_listed(given)} are given; give only one of them")
    if required and not given:
        raise ValueError(f"none of {_listed(keys)} is given; give exactly one of them")


def _listed(keys: list[str] | tuple[str, ...]) -> str:
    return ", ".join(keys[:-1]) + f" and {keys[-1]}"
