"""Draw the glossary's sketch: the dimensions of an instrument file on a straight instrument and on a bent joint."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Circle, Rectangle

from tenodesis.report import style

R, SMALL, STEM, HANDLE, TIP = 2.2, 1.2, 12.0, 8.0, 10.0  # not to scale
BEND = np.radians(50)


def draw(path: Path) -> None:
    """Write the sketch as SVG."""
    with style.applied():
        fig, (top, bottom) = style.figure(2, width=10.4, height=3.5)
        grid = top.get_subplotspec().get_gridspec()
        grid.set_width_ratios([2.3, 1])
        _straight(top)
        _bent(bottom)
        fig.savefig(path, metadata={"Date": None})


def _straight(axis: Axes) -> None:
    """Draw the straight instrument from the hand (left) to the tip (right), with its lengths."""
    hand, proximal = 0.0, HANDLE
    stem = proximal + 2 * R
    distal = stem + STEM
    moving = distal + 2 * SMALL
    tip = moving + TIP
    for left, right, width in ((hand, proximal, 4), (stem, distal, 7), (moving, tip, 3)):
        axis.plot([left, right], [0, 0], color=style.INK, lw=width, alpha=0.25, solid_capstyle="butt")
    for centre, radius in ((proximal, R), (stem, R), (distal, SMALL), (moving, SMALL)):
        axis.add_patch(Circle((centre, 0), radius, fill=False, ec=style.INK, lw=1.3))
        axis.plot(centre, 0, ".", color=style.INK, ms=4)
    for side, colour in ((1, style.AGONIST), (-1, style.ANTAGONIST)):
        axis.plot(
            [hand - 3.6, hand - 0.4, proximal, stem, distal, moving],
            [side * 4.4, side * 4.0, side * R, side * R, side * SMALL, side * SMALL],
            color=colour,
            lw=1.3,
        )
        axis.add_patch(Circle((hand - 4.3, side * 4.4), 0.7, fill=False, ec=colour, lw=1.3))
        axis.add_patch(Rectangle((hand - 2.6, side * 4.25 - 0.35), 0.9, 0.7, fc="white", ec=colour, lw=1.1, zorder=3))
        axis.plot([hand - 0.4, proximal - 2], np.interp([hand - 0.4, proximal - 2], [hand - 0.4, proximal],
                  [side * 4.0, side * R]), color=colour, lw=4, alpha=0.3)  # fmt: skip
    axis.text(-4.3, 6.0, "spool", ha="center", color=style.MUTED)
    axis.text(-1.9, 5.35, "load\ncell", ha="left", va="bottom", color=style.MUTED, linespacing=0.9)
    axis.text(2.3, 4.3, "sheath", color=style.MUTED)
    axis.text((stem + distal) / 2, 0.75, "stem", ha="center", color=style.MUTED)
    axis.text((proximal + stem) / 2, R + 0.6, "proximal\n(handle) joint", ha="center", color=style.MUTED)
    axis.text((distal + moving) / 2, SMALL + 0.9, "distal\njoint", ha="center", color=style.MUTED)
    axis.text(hand, -1.6, "hand", ha="center", color=style.MUTED)
    lengths = (
        (hand, proximal, -5.6, "handle_length  $l_p$"),
        (stem, distal, -5.6, "stem_length"),
        (moving, tip, -5.6, "end_effector_length  $l_d$"),
        (hand, tip, -8.2, "overall_length"),
    )
    for left, right, height, label in lengths:
        _dimension(axis, left, right, height, label)
    axis.annotate("", (stem, 0), (stem, -R), arrowprops={"arrowstyle": "<->", "color": style.MUTED, "lw": 0.9})
    axis.text(stem + 0.25, -R / 2 - 0.2, "$R$", color=style.INK)
    axis.annotate("", (distal, 0), (distal, -SMALL), arrowprops={"arrowstyle": "<->", "color": style.MUTED, "lw": 0.9})
    axis.text(distal - 0.3, -SMALL / 2 - 0.25, "$r$", color=style.INK, ha="right")
    axis.annotate("", (tip, 0), (tip, 3.4), arrowprops={"arrowstyle": "-|>", "color": style.ACCENT, "lw": 1.8})
    axis.text(tip, 3.7, "force $F$", color=style.ACCENT, ha="center")
    axis.set(xlim=(-6, tip + 2.2), ylim=(-9.6, 8), aspect="equal", title="straight, not to scale")
    axis.axis("off")


def _dimension(axis: Axes, left: float, right: float, height: float, label: str) -> None:
    """Draw a length between two places, with its extension lines."""
    for place in (left, right):
        axis.plot([place, place], [0, height - 0.4], color=style.REFERENCE, lw=0.6, zorder=0)
    axis.annotate("", (right, height), (left, height), arrowprops={"arrowstyle": "<->", "color": style.INK, "lw": 1})
    axis.text((left + right) / 2, height + 0.3, label, ha="center", va="bottom", color=style.INK, fontsize=8.5)


def _bent(axis: Axes) -> None:
    """Draw a bent distal joint: output angle, contact, vertices of the tendons and free span."""
    half = BEND / 2
    centre = 2 * np.array([np.cos(half), np.sin(half)])
    along, across = np.array([np.cos(BEND), np.sin(BEND)]), np.array([-np.sin(BEND), np.cos(BEND)])
    axis.plot([-3.2, 0], [0, 0], color=style.INK, lw=6, alpha=0.25, solid_capstyle="butt")
    axis.plot(*np.array([centre, centre + 3.4 * along]).T, color=style.INK, lw=3, alpha=0.25)
    for place in (np.zeros(2), centre):
        axis.add_patch(Circle((float(place[0]), float(place[1])), 1, fill=False, ec=style.INK, lw=1.3))
        axis.plot(*place, ".", color=style.INK, ms=4)
    axis.plot(*(centre / 2), "o", color=style.ACCENT, ms=4)
    axis.annotate("contact", centre / 2, (2.5, -1.0), color=style.ACCENT, fontsize=8.5,
                  arrowprops={"arrowstyle": "-", "color": style.ACCENT, "lw": 0.7})  # fmt: skip
    for side, colour in ((1, style.AGONIST), (-1, style.ANTAGONIST)):
        vertices = np.array([[0, side], centre + side * across])
        path = np.vstack([[-3.2, side], vertices, vertices[1] + 1.4 * along])
        axis.plot(*path.T, color=colour, lw=1.3)
        axis.plot(*vertices.T, "s", color=colour, ms=4)
    axis.annotate("vertices", (0, -1), (-2.3, -2.1), color=style.ANTAGONIST, fontsize=8.5,
                  arrowprops={"arrowstyle": "-", "color": style.ANTAGONIST, "lw": 0.7})  # fmt: skip
    span = (np.array([0, -1]) + centre - across) / 2
    axis.annotate("free span", span, (1.5, -2.3), color=style.MUTED, fontsize=8.5,
                  arrowprops={"arrowstyle": "-", "color": style.MUTED, "lw": 0.7})  # fmt: skip
    axis.plot([0, 5.2], [0, 0], color=style.REFERENCE, lw=0.7, ls=":")
    crossing = float(centre[0] - centre[1] / np.tan(BEND))
    axis.plot(*np.array([[crossing, 0], centre]).T, color=style.REFERENCE, lw=0.7, ls=":")
    axis.add_patch(Arc((crossing, 0), 6.4, 6.4, theta1=0, theta2=float(np.degrees(BEND)), color=style.INK, lw=1))
    axis.text(crossing + 3.5, 1.2, r"output angle $\theta_e$", color=style.INK)
    axis.set(xlim=(-3.6, 7.2), ylim=(-2.8, 5.2), aspect="equal", title="distal joint, bent")
    axis.axis("off")


if __name__ == "__main__":
    draw(Path(__file__).with_suffix(".svg"))
