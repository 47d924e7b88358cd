"""The version of the package."""

from tenodesis import _core

__version__ = _core.VERSION
