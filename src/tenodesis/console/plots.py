"""The curves of the last seconds in a browser, and the colours of tension."""

from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tenodesis.console.display import ShownSignals
from tenodesis.control.pairs import pairs
from tenodesis.control.parameters import tension_limit
from tenodesis.instrument import Instrument
from tenodesis.live.controlled import live_names
from tenodesis.run import Array
from tenodesis.simulate.places import Places

if TYPE_CHECKING:
    import viser

WINDOW = 10.0
"""Duration of the curves, s."""
ROWS = 160
"""Rows of the curves: more would need more pixels."""

INK, TARGET, ESTIMATED, EDGE = "#1b2733", "#168658", "#7c3aed", "rgba(124, 58, 237, 0.3)"
BAND = "rgba(124, 58, 237, 0.16)"
AGONIST, ANTAGONIST, LINE = "#b4232f", "#1f5fa8", "#6b7785"
_TENDONS = (AGONIST, ANTAGONIST, "#b8860b", "#0f766e", "#9333ea", "#db2777", "#4d7c0f", "#0369a1", *("#374151",) * 4)
"""Colours of a joint's tendons, in order."""

_WIDTH = 420
_HEIGHT = 112
_EMPTY = np.array([-WINDOW, 0.0])


class Plots:
    """Curves of angle, force, tensions, strokes and friction of one joint, and of currents that measure the tensions.

    Parameters
    ----------
    gui
        The browser's panel.
    inst
        The instrument.
    measured
        Whether the tip angle is known, and not only estimated.
    simulated
        Whether the load on the tip and the tensions are known, too.
    """

    def __init__(self, gui: "viser.GuiApi", inst: Instrument, *, measured: bool, simulated: bool) -> None:
        from viser import uplot  # noqa: PLC0415 - takes half a second

        self._colours, self._simulated = TensionColours(inst), simulated
        names = live_names(inst)
        self._joints, self._served = names.joints, names.compensated
        across = {} if Places.of(inst).takes_forces else pairs(inst)
        self._across = {names.joints[pair.joint]: ("yaw", "pitch").index(axis) for axis, pair in across.items()}
        """Component of the wrench that a force on a joint opposes, where the load is a wrench."""
        arms = inst.tendon_arms("tip")
        self._tendons = [np.flatnonzero(arms[:, j]) for j in range(len(names.joints))]
        """Tendons that turn each joint, by number."""
        self._names = names.tendons
        self._stretches = 1e3 * inst.pretensions / inst.stiffnesses
        panel = gui.add_panel()
        with panel.add_tab("Curves"):
            self.axis = gui.add_dropdown("Axis", self._joints, visible=len(self._joints) > 1)
            self._of = self._joints[0]
            """The joint whose tendons the charts name."""
            of_tendons = self._curves_of_tendons(0)
            self._angle = add_chart(
                gui,
                "Tip angle, deg",
                {
                    "target": TARGET,
                    "tip" if measured else "tip, estimated": INK,
                    "estimated": ESTIMATED,
                    "+2 std": EDGE,
                    "−2 std": EDGE,
                    "straight": LINE,
                },
                height=_HEIGHT,
                bands=(uplot.Band(series=(4, 5), fill=BAND),),
            )
            force = {"estimated": ESTIMATED, "+2 std": EDGE, "−2 std": EDGE, "none": LINE}
            if simulated:
                force["load"] = INK
            band = uplot.Band(series=(2, 3), fill=BAND)
            self._force = add_chart(gui, "Force at the tip, N", force, height=_HEIGHT, bands=(band,))
            currents = inst.sensors.kind == "current"
            self._current = add_chart(gui, "Motor current, A", of_tendons[0], height=_HEIGHT)
            self._current.visible = currents
            title = "Tendon tension by current, N" if currents and not simulated else "Tendon tension, N"
            self._tension = add_chart(gui, title, of_tendons[1], height=_HEIGHT)
            self._stroke = add_chart(gui, "Motor stroke, mm", of_tendons[2], height=_HEIGHT)
            self._friction = add_chart(
                gui, "Friction, ratio to the file", {"estimated": ESTIMATED, "file": LINE, "none": LINE}, height=_HEIGHT
            )
            self._grip = add_chart(gui, "Grip force, N", {"on the object": INK, "none": LINE}, height=_HEIGHT)
            self._grip.visible = simulated and inst.grip is not None
            self._friction.visible = self._force.visible = self._of in self._served
        panel.dock_left()
        panel.set_width(_WIDTH)

    def show(self, seconds: ShownSignals) -> None:
        """Draw the last seconds."""
        time = seconds.time
        joint = self._joints.index(self.axis.value)
        own = self._tendons[joint]
        if self._of != self.axis.value:
            self._name_tendons(joint)
        output = without_gaps(np.degrees(seconds.output[:, joint]), 0.0)
        target, estimated, deviation = (
            np.degrees(values[:, joint]) for values in (seconds.target, seconds.estimated, seconds.deviation)
        )
        target = without_gaps(target, output)
        estimated, deviation = without_gaps(estimated, output), without_gaps(deviation, 0.0)
        # Level lines also keep the scales from zooming into noise.
        level = np.ones(time.shape)
        edges = (estimated + 2 * deviation, estimated - 2 * deviation)
        self._set(self._angle, time, target, output, estimated, *edges, 0 * level)
        self._show_force(seconds, joint)
        self._set(self._current, time, *without_gaps(seconds.current[:, own], 0.0).T, 0 * level)
        slack, limit = self._colours.slack * level, self._colours.limit * level
        self._set(self._tension, time, *without_gaps(seconds.tension[:, own], 0.0).T, slack, limit)
        stretch = float(self._stretches[own].max()) * level
        self._set(self._stroke, time, *without_gaps(1e3 * seconds.stroke[:, own], 0.0).T, stretch, -stretch)
        self._set(self._friction, time, without_gaps(seconds.friction_scale[:, joint], 1.0), level, 0 * level)
        self._set(self._grip, time, without_gaps(seconds.grip_force[:, 0], 0.0), 0 * level)

    def _curves_of_tendons(self, joint: int) -> tuple[dict[str, str], dict[str, str], dict[str, str]]:
        """Return the curves of the charts of current, tension and stroke, with the tendons of a joint."""
        names = [self._names[tendon].removeprefix(f"{self._joints[joint]}_") for tendon in self._tendons[joint]]
        tendons = dict(zip(names, _TENDONS, strict=False))
        levels = (("none",), ("slack", "limit"), ("+ stretch at rest", "− stretch at rest"))
        current, tension, stroke = (tendons | dict.fromkeys(lines, LINE) for lines in levels)
        return current, tension, stroke

    def _name_tendons(self, joint: int) -> None:
        """Let the charts of tendons have those of a joint, and hide what the law alone knows where there is none."""
        self._of = self._joints[joint]
        for chart, curves in zip(
            (self._current, self._tension, self._stroke), self._curves_of_tendons(joint), strict=True
        ):
            chart.series = series(curves)
        self._friction.visible = self._force.visible = self._of in self._served

    def _show_force(self, seconds: ShownSignals, joint: int) -> None:
        load = np.nan_to_num(seconds.force[:, joint]) + np.nan_to_num(seconds.contact_force[:, joint])
        if self._joints[joint] in self._across:
            load -= np.nan_to_num(seconds.wrench[:, self._across[self._joints[joint]]])
        estimated = without_gaps(seconds.estimated_force[:, joint], 0.0)
        width = 2 * without_gaps(seconds.force_deviation[:, joint], 0.0)
        curves = (estimated, estimated + width, estimated - width, 0 * load, load)
        self._set(self._force, seconds.time, *curves[: 5 if self._simulated else 4])

    def _set(self, plot: Any, time: Array, *curves: Array) -> None:
        # The times increase: at equal ones the viewer would not draw an axis that had no room at first.
        if time.size > 1:
            plot.data = (time, *curves)


def add_chart(gui: Any, title: str, curves: Mapping[str, str], *, height: int, bands: Any = None) -> Any:
    """Add an empty chart of curves of these names and colours."""
    from viser import uplot  # noqa: PLC0415 - takes half a second

    return gui.add_uplot(
        data=(_EMPTY, *(np.zeros(2) for _ in curves)),
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
    """Return the styles of curves of these names and colours; level lines are dashed."""
    from viser import uplot  # noqa: PLC0415 - takes half a second

    make: Any = uplot.Series
    styles = [make(label="s")]
    for name, colour in curves.items():
        style: dict[str, Any] = {"label": name, "width": 1.8, "points": {"show": False}, "stroke": colour}
        if colour == LINE:
            style |= {"dash": (6, 4), "width": 1.2}
        styles.append(make(**style))
    return tuple(styles)


def without_gaps(values: Array, substitute: Array | float) -> Array:
    """Return values with a substitute where they are unknown: the viewer cannot scale curves with gaps."""
    return np.where(np.isfinite(values), values, np.nan_to_num(substitute))


SLACK = (138, 148, 163)
_STOPS = (
    (0.0, (52, 96, 190)),
    (0.35, (24, 140, 150)),
    (0.6, (205, 150, 20)),
    (0.8, (226, 98, 28)),
    (1.0, (178, 14, 40)),
)
"""Fraction of the limit, and colour: distinct for the colour-blind, and dark enough on white."""
_SLACK_FRACTION = 0.01
"""Fraction of the pretension below which a tendon is shown as slack."""


class TensionColours:
    """Colours of tension (N) for an instrument: grey when slack, from blue to red at the tension limit."""

    def __init__(self, inst: Instrument) -> None:
        wound: tuple[Any, ...] = (inst,) if inst.short_form is None else inst.planar
        self.limit = min(tension_limit(axis) for axis in wound)
        """Tension above which no tendon is wound, N."""
        self.pretension = wound[0].pretension
        self.slack = _SLACK_FRACTION * min(axis.pretension for axis in wound)

    def __call__(self, tension: Array) -> NDArray[np.uint8]:
        """Return colours, shape (..., 3), from 0 to 255; unknown tensions have the colour of slack tendons."""
        fractions = np.clip(np.nan_to_num(tension) / self.limit, 0, 1)
        places = [place for place, _ in _STOPS]
        channels = [np.interp(fractions, places, [colour[c] for _, colour in _STOPS]) for c in range(3)]
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
