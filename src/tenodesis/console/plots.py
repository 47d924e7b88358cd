"""The last seconds as curves, as one browser sees them."""

from typing import TYPE_CHECKING, Any

import numpy as np

from tenodesis.console.colours import TensionColours
from tenodesis.console.view import View
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

if TYPE_CHECKING:
    import viser

WINDOW = 10.0
"""Time that is shown, s."""
ROWS = 160
"""Rows that are sent, which is as many as the curves have pixels to show."""

INK, WANTED, ESTIMATED, EDGE = "#1b2733", "#168658", "#7c3aed", "rgba(124, 58, 237, 0.3)"
BAND = "rgba(124, 58, 237, 0.16)"
AGONIST, ANTAGONIST, LINE = "#b4232f", "#1f5fa8", "#6b7785"

_STEPS = tuple(digit * 10.0**power for power in range(-2, 4) for digit in (1, 2, 5))
_WIDTH = 420
_HEIGHT = 140
_NOTHING = np.array([-WINDOW, 0.0])


class Plots:
    """Curves of angle, tensions, stroke and friction of one axis.

    Parameters
    ----------
    gui
        Where they go.
    inst
        The instrument.
    """

    def __init__(self, gui: "viser.GuiApi", inst: Instrument) -> None:
        from viser import uplot  # noqa: PLC0415 - takes half a second

        self._uplot: Any = uplot
        self._inst, self._colours = inst, TensionColours(inst)
        panel = gui.add_panel()
        reach = np.ceil(np.degrees(inst.output_stop) / 10) * 10
        with panel.add_tab("Curves"):
            self.axis = gui.add_dropdown("Axis", inst.axes, visible=len(inst.axes) > 1)
            self._angle = self._plot(
                gui,
                "Tip angle, deg",
                {"wanted": WANTED, "is": INK, "estimated": ESTIMATED, "+2 std": "", "−2 std": ""},
                low=-reach,
                high=reach,
                bands=(uplot.Band(series=(4, 5), fill=BAND),),
            )
            self._tension = self._plot(
                gui,
                "Tendon tension, N",
                {"agonist": AGONIST, "antagonist": ANTAGONIST, "slack": LINE, "limit": LINE},
                low=0,
                high=1.15 * self._colours.limit,
            )
            self._stroke = self._plot(
                gui, "Motor stroke, mm wound", {"agonist": AGONIST, "antagonist": ANTAGONIST}, low=-1, high=1
            )
            self._friction = self._plot(
                gui, "Friction over what the file tells", {"estimated": ESTIMATED, "as told": LINE}, low=0, high=2
            )
        panel.dock_left()
        panel.set_width(_WIDTH)

    def show(self, seconds: View) -> None:
        """Draw the last seconds."""
        time = seconds.time - seconds.time[-1] if seconds.time.size else seconds.time
        axis = self._inst.axes.index(self.axis.value)
        wanted, output, estimated, deviation = (
            np.degrees(values[:, axis])
            for values in (seconds.wanted, seconds.output, seconds.estimated, seconds.deviation)
        )
        tension, stroke = seconds.tension[:, axis], 1e3 * seconds.stroke[:, axis]
        level = np.ones(time.shape)
        self._set(self._angle, time, wanted, output, estimated, estimated + 2 * deviation, estimated - 2 * deviation)
        slack, limit = self._colours.slack * level, self._colours.limit * level
        self._set(self._tension, time, tension[:, 0], tension[:, 1], slack, limit)
        self._fit(self._stroke, -1, stroke.ravel())
        self._set(self._stroke, time, stroke[:, 0], stroke[:, 1])
        scale = seconds.friction_scale[:, axis]
        self._fit(self._friction, 0, scale, 2 * level)
        self._set(self._friction, time, scale, level)

    def _set(self, plot: Any, time: Array, *curves: Array) -> None:
        if time.size > 1:
            # A row without values keeps the window as wide while the first seconds pass.
            plot.data = (np.append(-WINDOW, time), *(np.append(np.nan, curve) for curve in curves))

    def _fit(self, plot: Any, low: float, *curves: Array) -> None:
        """Give a plot a range in whole steps up to what it shows, so that it neither jumps nor shows noise large."""
        known = np.concatenate(curves)
        most = float(np.abs(known[np.isfinite(known)]).max(initial=0.0))
        reach = next((step for step in _STEPS if step >= most), most)
        scales = self._scales(low * reach, reach)
        if plot.scales != scales:
            plot.scales = scales

    def _scales(self, low: float, high: float) -> Any:
        return {"x": self._uplot.Scale(time=False), "y": self._uplot.Scale(range=(low, high))}

    def _plot(self, gui: Any, title: str, curves: dict[str, str], *, low: float, high: float, bands: Any = None) -> Any:
        """Add an empty plot of curves by name, each of a colour; without one it only bounds a band."""
        series = [self._uplot.Series(label="s")]
        for name, colour in curves.items():
            look: dict[str, Any] = {"label": name, "width": 1.8, "points": {"show": False}, "stroke": colour or EDGE}
            if colour == LINE:
                look |= {"dash": (6, 4), "width": 1.2}
            series.append(self._uplot.Series(**look))
        return gui.add_uplot(
            data=(_NOTHING, *(np.full(2, np.nan) for _ in curves)),
            series=tuple(series),
            title=title,
            scales=self._scales(low, high),
            axes=(
                self._uplot.Axis(label="time, s", labelSize=18, labelGap=0, size=24, gap=2),
                self._uplot.Axis(size=48),
            ),
            legend=self._uplot.Legend(show=True, live=False),
            cursor=self._uplot.Cursor(show=False),
            bands=bands,
            height=_HEIGHT,
            padding=(6, 12, 0, 0),
        )
