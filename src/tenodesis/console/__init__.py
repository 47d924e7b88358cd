"""The page in the browser: the instrument in space, its controls and its curves."""

from tenodesis.extras import require

require("viser", "live")  # before the modules that import it and what comes with it

from tenodesis.console.access import link_page  # noqa: E402
from tenodesis.console.assembly import load as load_parts  # noqa: E402
from tenodesis.console.page import Page, serve  # noqa: E402

__all__ = ["Page", "link_page", "load_parts", "serve"]
