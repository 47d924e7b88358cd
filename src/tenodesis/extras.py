"""Optional dependencies: imported where they are used, and named where they are missing."""

import importlib
from types import ModuleType

from tenodesis.errors import MissingExtraError


def require(module: str, extra: str) -> ModuleType:
    """Return an imported module that an optional extra of this package installs.

    Parameters
    ----------
    module
        Name of the module, "can" or "foxglove.channel".
    extra
        Name of the extra, "devices".

    Raises
    ------
    MissingExtraError
        The module is not installed; the message states what to install.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as problem:
        missing = (problem.name or module).partition(".")[0]
        if missing != module.partition(".")[0]:
            raise
        raise MissingExtraError(missing, extra) from None
