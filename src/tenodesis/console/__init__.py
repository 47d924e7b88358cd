"""The page in the browser: the instrument in space, its controls and its curves."""

from tenodesis.console.page import Page, serve

__all__ = ["Page", "serve"]
