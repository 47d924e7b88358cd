"""Draw the README's picture: the distal joint with and without a load, and the curve that goes with it."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

import tenodesis as tn
from tenodesis.instrument import TendonGear
from tenodesis.report import style

FORCE = 1.0
SHOWN = 23.0  # mm of the end-effector: all of it would leave no room to see the joint


def draw(path: Path) -> None:
    """Write the picture as SVG."""
    inst = tn.load("real-size")
    assert isinstance(inst, TendonGear)
    handle = float(tn.statics.handle_angle(inst, np.radians(60)))
    with style.applied():
        fig, (left, right) = style.figure(2, width=9.2, height=3.9)
        for force, color, alpha in ((0.0, style.REFERENCE, 0.55), (FORCE, style.INK, 1.0)):
            _joint(left, inst, float(tn.statics.output_angle(inst, handle, force)), color, alpha)
        left.set(xlim=(-13, 29), ylim=(-12, 25), aspect="equal")
        left.axis("off")
        left.text(28, 8.5, "no load, 60°", color=style.MUTED, ha="right")
        left.text(13.5, 22.5, f"under {FORCE:g} N,\nhandle held", ha="right")
        left.text(3.2, -9, "agonist", color=style.AGONIST, va="center")
        left.text(-3.2, -9, "antagonist", color=style.ANTAGONIST, va="center", ha="right")
        sweep = np.linspace(0, float(tn.statics.handle_angle(inst, inst.output_range)), 200)
        for force, color in ((0.0, style.INK), (0.5, style.LOADS[0]), (1.0, style.LOADS[1]), (2.0, style.LOADS[2])):
            output = np.degrees(tn.statics.output_angle(inst, sweep, force))
            right.plot(np.degrees(sweep), output, color=color, label="no load" if force == 0 else f"{force:g} N")
        right.set(xlabel="handle angle [deg]", ylabel="output angle [deg]", xlim=(0, np.degrees(sweep[-1])))
        right.legend(loc="upper left")
        fig.savefig(path, metadata={"Date": None})


def _joint(axis: Axes, inst: TendonGear, angle: float, color: str, alpha: float) -> None:
    """Draw the rolling gear pair, the end-effector and both tendons at an output angle (rad), in mm."""
    r, half = 1e3 * inst.distal_gear_radius, angle / 2
    centre = 2 * r * np.array([np.sin(half), np.cos(half)])
    across, along = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    tip = centre + SHOWN * along
    axis.plot(*np.array([[0, -14], [0, 0]]).T, color=color, lw=5, alpha=0.35 * alpha, solid_capstyle="butt")
    axis.plot(*np.array([centre, tip]).T, color=color, lw=3, alpha=alpha, solid_capstyle="round")
    for place in (np.zeros(2), centre):
        axis.add_patch(Circle((float(place[0]), float(place[1])), r, fill=False, ec=color, lw=1.4, alpha=alpha))
    for side, hue in ((1, style.AGONIST), (-1, style.ANTAGONIST)):
        path = np.array(
            [[side * r, -14], [side * r, 0], centre + side * r * across, centre + r * (side * across + 2 * along)]
        )
        axis.plot(*path.T, color=hue, lw=1.3, alpha=alpha)
