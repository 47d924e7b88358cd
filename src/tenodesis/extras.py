"""Optional dependencies and parts: imported where they are used, and named where they are missing."""

import importlib
from types import ModuleType

from tenodesis import _core
from tenodesis.errors import LiveError, MissingExtraError


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
        The module is not installed, or cannot be imported as it is; the message states what to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as problem:
        name = module.partition(".")[0]
        absent = isinstance(problem, ModuleNotFoundError) and (problem.name or name).partition(".")[0] == name
        raise MissingExtraError(name, extra, "" if absent else str(problem)) from None


def require_live() -> None:
    """Check that the C++ module has the live runtime and the link to boards.

    Raises
    ------
    LiveError
        It was built without them, as on systems other than Linux.
    """
    if not hasattr(_core, "Runtime"):
        raise LiveError("The live runtime and the link to boards are not part of this build; they run on Linux.")
