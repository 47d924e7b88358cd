"""Independent checks: the same instrument in code of others that shares nothing with the core."""

from importlib import import_module
from typing import Any

from tenodesis.errors import MissingLibraryError


def peer(module: str, name: str) -> Any:
    """Import a library of the extra "verify".

    Raises
    ------
    MissingLibraryError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError as absent:
        raise MissingLibraryError(f"{name} is not installed: pip install 'tenodesis[verify]'") from absent
