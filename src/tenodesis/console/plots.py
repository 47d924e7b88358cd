"""The last seconds as curves, as one browser sees them."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tenodesis.console.plots import TensionColours
from tenodesis.console.display import ShownSignals
from tenodesis.instrument import Instrument
from tenodesis.run import Array

if TYPE_CHECKING:
    import viser

WINDOW = 10.0
"""Time that is shown, s."""
ROWS = 160
"""Rows that are sent, which is as many as the curves have pixels to show."""

INK, TARGET, ESTIMATED, EDGE = "#1b2733", "#168658", "#7c3aed", "rgba(124, 58, 237, 0.3)"
BAND = "rgba(124, 58, 237, 0.16)"
AGONIST, ANTAGONIST, LINE = "#b4232f", "#1f5fa8", "#6b7785"

_WIDTH = 420
_HEIGHT = 128
_NOTHING = np.array([-WINDOW, 0.0])


class Plots:
    """Curves of angle, tensions, stroke and friction of one axis.

    Parameters
    ----------
    gui
        Where they go.
    inst
        The instrument.
    measured
        Whether anything but the estimate tells the tip angle.
    """

    def __init__(self, gui: "viser.GuiApi", inst: Instrument, *, measured: bool) -> None:
        from viser import uplot  # noqa: PLC0415 - takes half a second

        self._inst, self._colours = inst, TensionColours(inst)
        panel = gui.add_panel()
        single = [inst.axis(name) for name in inst.axes]
        self._stretches = [1e3 * one.pretension / one.tendon_stiffness for one in single]
        with panel.add_tab("Curves"):
            self.axis = gui.add_dropdown("Axis", inst.axes, visible=len(inst.axes) > 1)
            self._angle = add_chart(
                gui,
                "Tip angle, deg",
                {
                    "hand asks": TARGET,
                    "is" if measured else "is, as estimated": INK,
                    "estimated": ESTIMATED,
                    "+2 std": EDGE,
                    "−2 std": EDGE,
                    "straight": LINE,
                },
                height=_HEIGHT,
                bands=(uplot.Band(series=(4, 5), fill=BAND),),
            )
            self._tension = add_chart(
                gui,
                "Tendon tension, N",
                {"agonist": AGONIST, "antagonist": ANTAGONIST, "slack": LINE, "limit": LINE},
                height=_HEIGHT,
            )
            self._stroke = add_chart(
                gui,
                "Motor stroke, mm wound",
                {"agonist": AGONIST, "antagonist": ANTAGONIST, "+ stretch at rest": LINE, "− stretch at rest": LINE},
                height=_HEIGHT,
            )
            self._friction = add_chart(
                gui,
                "Friction, times what the file tells",
                {"estimated": ESTIMATED, "as told": LINE, "none": LINE},
                height=_HEIGHT,
            )
        panel.dock_left()
        panel.set_width(_WIDTH)

    def show(self, seconds: ShownSignals) -> None:
        """Draw the last seconds."""
        time = seconds.time
        axis = self._inst.axes.index(self.axis.value)
        output = known(np.degrees(seconds.output[:, axis]), 0.0)
        target, estimated, deviation = (
            np.degrees(values[:, axis]) for values in (seconds.target, seconds.estimated, seconds.deviation)
        )
        tension, stroke = seconds.tension[:, axis], 1e3 * seconds.stroke[:, axis]
        estimated, deviation = known(estimated, output), known(deviation, 0.0)
        # Level lines also keep the scales from following noise alone.
        level = np.ones(time.shape)
        edges = (estimated + 2 * deviation, estimated - 2 * deviation)
        self._set(self._angle, time, target, output, estimated, *edges, 0 * level)
        slack, limit = self._colours.slack * level, self._colours.limit * level
        self._set(self._tension, time, tension[:, 0], tension[:, 1], slack, limit)
        stretch = self._stretches[axis] * level
        self._set(self._stroke, time, stroke[:, 0], stroke[:, 1], stretch, -stretch)
        self._set(self._friction, time, known(seconds.friction_scale[:, axis], 1.0), level, 0 * level)

    def _set(self, plot: Any, time: Array, *curves: Array) -> None:
        # Times go on: with others that stood still, the viewer would not draw an axis that had no room at first.
        if time.size > 1:
            plot.data = (time, *curves)


def add_chart(gui: Any, title: str, curves: Mapping[str, str], *, height: int, bands: Any = None) -> Any:
    """Add an empty chart of curves by name, each of a colour."""
    from viser import uplot  # noqa: PLC0415 - takes half a second

    return gui.add_uplot(
        data=(_NOTHING, *(np.zeros(2) for _ in curves)),
        series=series(curves),
        title=title,
        scales={"x": uplot.Scale(time=False)},
        axes=(uplot.Axis(label="time, s", labelSize=18, labelGap=0, size=24, gap=2), uplot.Axis(size=56)),
        legend=uplot.Legend(show=True, live=False),
        cursor=uplot.Cursor(show=False),
        bands=bands,
        height=height,
        padding=(6, 12, 0, 0),
    )


def series(curves: Mapping[str, str]) -> tuple[Any, ...]:
    """Return how curves by name, each of a colour, are drawn over time; level lines are dashed."""
    from viser import uplot  # noqa: PLC0415 - takes half a second

    one: Any = uplot.Series
    drawn = [one(label="s")]
    for name, colour in curves.items():
        look: dict[str, Any] = {"label": name, "width": 1.8, "points": {"show": False}, "stroke": colour}
        if colour == LINE:
            look |= {"dash": (6, 4), "width": 1.2}
        drawn.append(one(**look))
    return tuple(drawn)


def known(values: Array, instead: Array | float) -> Array:
    """Return values with others instead where there are none: one gap would cost the viewer its scale."""
    return np.where(np.isfinite(values), values, np.nan_to_num(instead))


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
        single = [inst.axis(name) for name in inst.axes]
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
