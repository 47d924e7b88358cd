"""Values as JSON has them."""

import math
from collections.abc import Mapping
from typing import Any


def json_values(value: Any) -> Any:
    """Return a value as JSON has it: arrays and tuples as lists, None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {key: json_values(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(one) for one in value]
    if hasattr(value, "tolist"):
        return json_values(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
