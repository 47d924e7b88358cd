"""Draw the sketch of joints that share tendons: axes and positive angles, and the arms of a tendon by its side."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Circle

from tenodesis.report import style

BEND = np.radians(35)
RADIUS, LENGTH = 1.0, 5.0  # not to scale


def draw(path: Path) -> None:
    """Write the sketch as SVG."""
    with style.applied():
        fig, (axes, arms) = style.figure(2, width=10.4, height=3.3)
        _axes(axes)
        _arms(arms)
        fig.savefig(path, metadata={"Date": None})


def _arrow(axis: Axes, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    axis.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5})


def _axes(axis: Axes) -> None:
    """Draw the tip, straight and bent by a positive yaw, with the axes of stem and tip."""
    tip = LENGTH * np.array([np.cos(BEND), np.sin(BEND)])
    axis.plot([-5, 0], [0, 0], color=style.INK, lw=7, alpha=0.25, solid_capstyle="butt")
    axis.plot([0, LENGTH], [0, 0], color=style.MUTED, lw=1, ls="--")
    axis.plot([0, tip[0]], [0, tip[1]], color=style.INK, lw=4, alpha=0.35, solid_capstyle="butt")
    axis.add_patch(Circle((0, 0), 0.35, fc="white", ec=style.INK, lw=1.3, zorder=3))
    axis.add_patch(Arc((0, 0), 5.6, 5.6, theta1=2, theta2=np.degrees(BEND) - 4, color=style.INK, lw=1.2))
    axis.text(3.0, 0.75, r"$\theta$ > 0, yaw", color=style.INK)
    for at, turn, name in ((np.array([-4.2, 0.9]), 0.0, "stem's axes"), (tip, BEND, "tip's axes")):
        along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        for letter, direction in (("z", along), ("x", across)):
            _arrow(axis, tuple(at), tuple(at + 1.5 * direction), style.ACCENT)
            axis.text(*(at + 1.8 * direction), letter, color=style.ACCENT, ha="center", va="center")
        axis.add_patch(Circle(tuple(at), 0.16, fc="white", ec=style.ACCENT, lw=1.2, zorder=4))
        axis.plot(*at, ".", color=style.ACCENT, ms=3, zorder=5)
        axis.text(*(at - 0.42 * across + 0.15 * along), "y", color=style.ACCENT, ha="center", va="center")
        beside = np.array([-0.35, -0.25] if turn else [0.3, 0.6])
        axis.text(*(at + beside), name, color=style.MUTED, fontsize=8.5, ha="right" if turn else "left",
                  va="bottom" if turn else "center")  # fmt: skip
    axis.text(-2.5, -0.75, "stem", color=style.MUTED, ha="center")
    axis.text(-5, -1.6, "y points at the reader; a positive pitch bends the tip toward y", color=style.MUTED,
              fontsize=8.5)  # fmt: skip
    axis.set(xlim=(-5.6, 7.2), ylim=(-2.0, 5.2), aspect="equal", title="axes and positive angles")
    axis.axis("off")


def _arms(axis: Axes) -> None:
    """Draw a joint with a tendon on either side and one through its middle."""
    axis.add_patch(Circle((0, 0), RADIUS, fc="none", ec=style.INK, lw=1.3))
    rows = (
        (RADIUS, style.AGONIST, "agonist, arm $+r$: its pull bends the joint to positive angles"),
        (0.0, style.MUTED, "middle, arm 0: does not bend it"),
        (-RADIUS, style.ANTAGONIST, "antagonist, arm $-r$"),
    )
    for height, colour, label in rows:
        axis.plot([-4, 2.6], [height, height], color=colour, lw=1.6, zorder=2)
        axis.plot(2.6, height, "s", color=colour, ms=5)
        axis.text(3.0, height, label, color=colour, va="center", fontsize=8.5)
    axis.annotate("", (-0.05, RADIUS), (-0.05, 0), arrowprops={"arrowstyle": "<->", "color": style.INK, "lw": 0.9})
    axis.text(-0.2, RADIUS / 2, "$r$", ha="right", va="center")
    _arrow(axis, (-4, -1.9), (-2.2, -1.9), style.ACCENT)
    axis.text(-4, -2.35, "z, toward the tip", color=style.ACCENT, fontsize=8.5)
    axis.set(xlim=(-4.4, 12.5), ylim=(-3.2, 2.4), aspect="equal", title="arms by side")
    axis.axis("off")
