"""The colours of tension, from slack to the limit."""

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from tenodesis.control.parameters import tension_limit
from tenodesis.instrument import Instrument
from tenodesis.run import Array

SLACK = (138, 148, 163)
_STOPS = (
    (0.0, (52, 96, 190)),
    (0.35, (24, 140, 150)),
    (0.6, (205, 150, 20)),
    (0.8, (226, 98, 28)),
    (1.0, (178, 14, 40)),
)
"""Share of the limit, and colour: told apart by those who do not tell red from green, and dark enough on white."""
_SLACK_SHARE = 0.01
"""Of the pretension, below which a tendon counts as slack here."""


class TensionColours:
    """Colours of tension (N) for an instrument: grey when slack, from blue to red at the tension limit."""

    def __init__(self, inst: Instrument) -> None:
        single = [inst] if len(inst.axes) == 1 else [inst.axis(name) for name in inst.axes]
        self.limit = min(tension_limit(one) for one in single)
        """Tension above which no tendon is wound, N."""
        self.pretension = single[0].pretension
        self.slack = _SLACK_SHARE * min(one.pretension for one in single)

    def __call__(self, tension: Array) -> NDArray[np.uint8]:
        """Return colours (..., 3) from 0 to 255; what is not known has that of slack tendons."""
        shares = np.clip(np.nan_to_num(tension) / self.limit, 0, 1)
        places = [place for place, _ in _STOPS]
        channels = [np.interp(shares, places, [colour[c] for _, colour in _STOPS]) for c in range(3)]
        tight = (tension > self.slack)[..., np.newaxis]
        return np.where(tight, np.stack(channels, -1).round(), SLACK).astype(np.uint8)

    def legend(self) -> str:
        """Return the scale as HTML, with its ends and the pretension in N."""
        ramp = ", ".join(f"rgb{colour} {100 * place:.0f}%" for place, colour in _STOPS)
        at = 100 * self.pretension / self.limit if isfinite(self.limit) else 0
        pretension = (
            f'<div style="position:relative;height:1.2em"><span style="position:absolute;left:{at:.0f}%;'
            f'transform:translateX(-50%);white-space:nowrap">↑ pretension {self.pretension:.3g} N</span></div>'
        )
        return (
            '<div style="font-size:.75rem;line-height:1.2;color:#4a5563">'
            '<div style="display:flex;justify-content:space-between"><span>'
            f'<span style="display:inline-block;width:.8em;height:.8em;background:rgb{SLACK};border-radius:2px;'
            'vertical-align:-.1em"></span> slack</span><span>tendon tension</span>'
            f"<span>limit {self.limit:.3g} N</span></div>"
            f'<div style="height:.6em;border-radius:2px;background:linear-gradient(90deg, {ramp})"></div>'
            f"{pretension}</div>"
        )
