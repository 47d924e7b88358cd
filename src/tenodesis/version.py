"""The version of the package."""

from tenodesis._core import VERSION as __version__

__all__ = ["__version__"]
