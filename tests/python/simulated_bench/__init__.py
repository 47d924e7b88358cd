"""Simulated hardware, for tests of devices and for trying them without a bench."""

from tenodesis.extras import require

require("can", "devices")
require("canopen", "devices")
