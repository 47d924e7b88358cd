"""Root mean squares."""

from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray


@overload
def rms(values: ArrayLike, axis: None = None) -> float: ...
@overload
def rms(values: ArrayLike, axis: int) -> NDArray[np.float64]: ...
def rms(values: ArrayLike, axis: int | None = None) -> float | NDArray[np.float64]:
    """Return the root of the mean square, of all values or along an axis; NaN where a value is."""
    root = np.sqrt(np.mean(np.square(values), axis=axis))
    return float(root) if axis is None else np.asarray(root)


def rms_of_finite(values: ArrayLike) -> float:
    """Return the root of the mean square of the finite values; NaN if there is none."""
    given = np.asarray(values)
    finite = given[np.isfinite(given)]
    return rms(finite) if finite.size else float("nan")
