"""The routing of an instrument: its joints unrolled from handle to tip, every tendon a line on its side of each."""

import textwrap
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tenodesis.instrument import Crossing, FullForm, Joint, RouteError, Tendon
from tenodesis.report import style
from tenodesis.statics import straight_arms

# Sizes in inches: the axes of the picture have them as coordinates.
_LANE = 0.2
_BOX, _GAP, _STEM = 1.4, 0.6, 0.6
_HEADER = 0.72
_BETWEEN = 0.35
_WIDEST = 14.0  # beyond which the table stands below
_MARGIN = 0.25
_LETTER = 0.082  # width of a letter of a label, on average
_ROW = 0.22
_BANDS = ("agonist", "middle", "antagonist")
_TINTS = {"agonist": "#fbeaea", "middle": "#ffffff", "antagonist": "#e8f0f9"}
_WRONG = "#d00000"
_LEGEND = (
    "Each tendon runs from its spool (○) or anchor (□) at the handle to its end (■). Above the middle of a joint, red: "
    "agonist, bends it to positive angles. Below, blue: antagonist. Dashed: passes the joint, which its route does not "
    "name. Numbers are radii in mm."
)


class _Pass(NamedTuple):
    """A tendon in a joint's box; without a crossing it is not part of its route."""

    tendon: int
    crossing: Crossing | None

    @property
    def band(self) -> str:
        return "middle" if self.crossing is None else (self.crossing.side or "middle")


class _Box:
    """A joint in the picture, with a lane for every passage of a tendon."""

    def __init__(self, joint: Joint | None, name: str, column: int) -> None:
        self.joint, self.name, self.column = joint, name, column
        self.passes: list[_Pass] = []
        self.left = self.middle = 0.0
        self.lanes: dict[int, float] = {}
        """Height of each passage, by its place in `passes`."""

    @property
    def band_heights(self) -> dict[str, float]:
        return {band: _LANE * max(1, sum(one.band == band for one in self.passes)) for band in _BANDS}

    @property
    def height(self) -> float:
        return sum(self.band_heights.values())

    def radius(self, crossing: Crossing) -> float:
        if crossing.radius is not None:
            return crossing.radius
        return 0.0 if self.joint is None else self.joint.radius

    def place_lanes(self, before: Sequence[float]) -> None:
        """Give every passage a lane: larger radii farther out, else in the order in which tendons come, by height."""
        top = self.middle + self.height / 2
        for band, height in self.band_heights.items():
            places = [place for place, one in enumerate(self.passes) if one.band == band]

            def order(
                place: int, outward: float = {"agonist": -1, "antagonist": 1}.get(band, 0)
            ) -> tuple[float, float]:
                one = self.passes[place]
                radius = 0.0 if one.crossing is None else self.radius(one.crossing)
                return outward * radius, -before[one.tendon]

            for lane, place in enumerate(sorted(places, key=order)):
                self.lanes[place] = top - height * (lane + 0.5) / len(places)
            top -= height


def draw(inst: FullForm, problem: RouteError | None = None) -> Figure:
    """Return the picture of an instrument's routing, with the moment arms of its straight joints as a table.

    What is wrong with a route is marked in red.
    """
    boxes, paths = _boxes(inst)
    table_width = _table_width(inst)
    left = _MARGIN + 0.35 + _LETTER * max(len(tendon.name) for tendon in inst.tendons)
    right = _place_columns(inst, boxes, left)
    stacks = _stacks(boxes).values()
    tallest = max(sum(box.height + _HEADER for box in stack) + _BETWEEN * (len(stack) - 1) for stack in stacks)
    rows = _ROW * (len(inst.tendons) + 3)
    beside = right + _GAP + table_width + _MARGIN <= _WIDEST
    width = right + _GAP + table_width + _MARGIN if beside else max(right, left + table_width) + _MARGIN
    notes = _wrapped(_LEGEND, width)
    wrong = _wrapped(f"Wrong: {problem}.", width) if problem else []
    foot = _MARGIN + 0.17 * (len(notes) + len(wrong)) + 0.15
    body = max(tallest, rows) if beside else tallest + _BETWEEN + rows
    height = body + foot + 0.55
    centre = foot + body - (body if beside else tallest) / 2
    _place_heights(inst, boxes, centre)
    with style.applied():
        fig = style.StyledFigure(figsize=(width, height))
        axis = fig.add_axes((0, 0, 1, 1))
        axis.set(xlim=(0, width), ylim=(0, height))
        axis.axis("off")
        axis.text(_MARGIN, height - _MARGIN, inst.name, weight="bold", va="top", fontsize=11)
        colours = tendon_colours(len(inst.tendons))
        _draw_links(axis, inst, boxes, left)
        for box in boxes:
            _draw_box(axis, box, colours, problem)
        for tendon, path, colour in zip(inst.tendons, paths, colours, strict=True):
            wrong_here = problem is not None and tendon.name == problem.tendon
            _draw_tendon(axis, tendon, path, left, colour=colour, wrong=wrong_here)
        corner = (right + _GAP, centre + rows / 2) if beside else (_MARGIN, foot + rows)
        _draw_table(axis, inst, colours, *corner)
        lines = [(line, style.MUTED, "normal") for line in notes] + [(line, _WRONG, "bold") for line in wrong]
        for n, (line, colour, weight) in enumerate(reversed(lines)):
            axis.text(_MARGIN, _MARGIN + 0.17 * n, line, color=colour, weight=weight, fontsize=8)
    return fig


def write(path: Path, inst: FullForm, problem: RouteError | None = None) -> None:
    """Write the picture as SVG, PNG or PDF; names and numbers in an SVG stay text."""
    with mpl.rc_context({"svg.fonttype": "none"}):
        draw(inst, problem).savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def _boxes(inst: FullForm) -> tuple[list[_Box], list[list[tuple[_Box, int]]]]:
    """Return the joints from handle to tip, unknown ones of a wrong route last, and each tendon's way through them."""
    handles, tips = inst.handle_joints[::-1], inst.tip_joints
    boxes = [_Box(joint, joint.name, column) for column, joint in enumerate(handles)]
    depths: list[int] = []
    for parent in inst.parents:
        depths.append(0 if parent < 0 else depths[parent] + 1)
    boxes += [_Box(joint, joint.name, len(handles) + depth) for joint, depth in zip(tips, depths, strict=True)]
    known = {box.name: box for box in boxes}
    for tendon in inst.tendons:
        column = len(handles)
        for crossing in tendon.route:
            if crossing.joint not in known:
                known[crossing.joint] = _Box(None, crossing.joint, column)
                boxes.append(known[crossing.joint])
            column = known[crossing.joint].column + 1
    return boxes, [list(_path(inst, known, n, tendon)) for n, tendon in enumerate(inst.tendons)]


def _path(inst: FullForm, boxes: dict[str, _Box], n: int, tendon: Tendon) -> Iterator[tuple[_Box, int]]:
    """Yield the boxes that a tendon runs through and its passage in each, joints that it only passes included."""
    crossed = [(boxes[crossing.joint], crossing) for crossing in tendon.route]
    # Files may name the handle's joints in either order.
    handles = [(box, crossing) for box, crossing in crossed if box.column < len(inst.handle_joints)]
    crossed = [*sorted(handles, key=lambda one: one[0].column), *(one for one in crossed if one not in handles)]
    end = max((box for box, _ in crossed if box.joint is not None), key=lambda box: box.column, default=None)
    chain = [box for box in boxes.values() if box.joint is not None and box.joint.place == "handle"]
    tips = [joint.name for joint in inst.tip_joints]
    at = -1 if end is None or end.name not in tips else tips.index(end.name)
    while at >= 0:
        chain.append(boxes[tips[at]])
        at = inst.parents[at]
    visited = {box.column for box, _ in crossed}
    passed = sorted((box for box in chain if box.column not in visited), key=lambda box: box.column)
    for box, crossing in crossed:
        while passed and passed[0].column < box.column:
            yield _passed(passed.pop(0), n, None)
        yield _passed(box, n, crossing)


def _passed(box: _Box, tendon: int, crossing: Crossing | None) -> tuple[_Box, int]:
    box.passes.append(_Pass(tendon, crossing))
    return box, len(box.passes) - 1


def _stacks(boxes: Sequence[_Box]) -> dict[int, list[_Box]]:
    """Return the boxes by column: jaws stand above each other."""
    stacks = defaultdict(list)
    for box in boxes:
        stacks[box.column].append(box)
    return stacks


def _place_columns(inst: FullForm, boxes: Sequence[_Box], left: float) -> float:
    """Place the boxes from left to right; returns where the picture of the joints ends."""
    handles = len(inst.handle_joints)
    for box in boxes:
        box.left = left + _GAP + box.column * (_BOX + _GAP) + (_STEM if box.column >= handles else 0.0)
    return max(box.left for box in boxes) + _BOX + _GAP


def _place_heights(inst: FullForm, boxes: Sequence[_Box], centre: float) -> None:
    """Place the boxes and the lanes in them by height, those of a column after those before it."""
    before = [-float(n) for n in range(len(inst.tendons))]
    for _, stack in sorted(_stacks(boxes).items()):
        total = sum(box.height + _HEADER for box in stack) + _BETWEEN * (len(stack) - 1)
        top = centre + total / 2
        for box in stack:
            box.middle = top - _HEADER - box.height / 2
            top -= box.height + _HEADER + _BETWEEN
        for box in stack:
            box.place_lanes(before)
        for box in stack:
            for place, one in enumerate(box.passes):
                before[one.tendon] = box.lanes[place]


def _draw_links(axis: Axes, inst: FullForm, boxes: Sequence[_Box], left: float) -> None:
    """Draw what the joints stand on, and the ends: a grey bar from joint to joint."""
    by_name = {box.name: box for box in boxes}

    def bar(start: tuple[float, float], end: tuple[float, float], width: float = 7) -> None:
        xs, ys = zip(start, end, strict=True)
        axis.plot(xs, ys, color=style.GRID, lw=width, solid_capstyle="butt", zorder=0)

    handles = [by_name[joint.name] for joint in inst.handle_joints[::-1]]
    tips = [by_name[joint.name] for joint in inst.tip_joints]
    first = [box for box, parent in zip(tips, inst.parents, strict=True) if parent < 0]
    for near, far in pairwise(handles):
        bar((near.left + _BOX, near.middle), (far.left, far.middle))
    stem = handles[-1].left + _BOX if handles else left + _GAP
    begin = handles[-1].middle if handles else first[0].middle
    for box in first:
        bar((stem, begin), (box.left, box.middle), 16)
    top = max(box.middle + box.height / 2 for box in (*handles[-1:], *first))
    length = "" if inst.stem_length is None else f"\n{_mm(inst.stem_length)} mm"
    axis.text((stem + first[0].left) / 2, top + 0.08, f"stem{length}", ha="center", va="bottom", color=style.MUTED,
              fontsize=8)  # fmt: skip
    for box, parent in zip(tips, inst.parents, strict=True):
        if parent >= 0:
            bar((tips[parent].left + _BOX, tips[parent].middle), (box.left, box.middle))
    for i in inst.ends:
        box = tips[i]
        x, end = box.left + _BOX, box.left + _BOX + _GAP
        axis.fill([x, x, end, end], [box.middle + y for y in (0.12, -0.12, -0.03, 0.03)], color=style.GRID, zorder=0)
        long = inst.tip_joints[i].end_effector_length
        length = "" if long is None else f"\n{_mm(long)} mm"
        axis.text(end, box.middle + box.height / 2 + 0.08, f"{'jaw' if i in inst.jaws else 'end'}{length}",
                  ha="right", va="bottom", color=style.MUTED, fontsize=8)  # fmt: skip


def _draw_box(axis: Axes, box: _Box, colours: Sequence[str], problem: RouteError | None) -> None:
    """Draw a joint: what it is above, the sides as bands, and the radius of every tendon in its lane."""
    top, bottom = box.middle + box.height / 2, box.middle - box.height / 2
    wrong = problem is not None and box.name in problem.joints
    upper = top
    for band, height in box.band_heights.items():
        axis.add_patch(Rectangle((box.left, upper - height), _BOX, height, fc=_TINTS[band], ec="none", zorder=1))
        upper -= height
    edge: dict[str, Any] = (
        {"ec": _WRONG, "lw": 2.5, "ls": "-" if box.joint else "--"} if wrong else {"ec": style.MUTED, "lw": 0.9}
    )
    axis.add_patch(Rectangle((box.left, bottom), _BOX, top - bottom, fill=False, zorder=4, **edge))
    centre = box.left + _BOX / 2
    name = "\n".join(textwrap.wrap(box.name.replace("_", "_ "), 17)).replace("_ ", "_")
    about = "not listed" if box.joint is None else _about(box.joint)
    axis.text(centre, top + 0.06, about, ha="center", va="bottom", fontsize=7.5, color=style.MUTED, linespacing=1.1)
    above = 0.06 + 0.125 * (about.count("\n") + 1) + 0.05
    colour = _WRONG if wrong else style.INK
    axis.text(centre, top + above, name, ha="center", va="bottom", fontsize=9, weight="bold", color=colour)
    for place, one in enumerate(box.passes):
        if one.crossing is None:
            continue
        radius = one.crossing.radius if box.joint is None else box.radius(one.crossing)
        label = "middle" if one.crossing.side == "middle" else "?" if radius is None else _mm(radius)
        axis.text(centre, box.lanes[place], label, ha="center", va="center", fontsize=7.5, color=colours[one.tendon],
                  zorder=5, bbox={"fc": _TINTS[one.band], "ec": "none", "pad": 0.8})  # fmt: skip


def _draw_tendon(
    axis: Axes, tendon: Tendon, path: Sequence[tuple[_Box, int]], left: float, *, colour: str, wrong: bool
) -> None:
    """Draw a tendon from its start through its lanes to its end."""
    line, width = (_WRONG, 2.4) if wrong else (colour, 1.4)
    box, place = path[0]
    at = (left, box.lanes[place])
    axis.plot(*at, "o" if tendon.start == "spool" else "s", color=line, mfc="white", ms=5, zorder=3)
    axis.text(left - 0.1, at[1], tendon.name, ha="right", va="center", fontsize=8, color=line)
    into = at
    for n, (box, place) in enumerate(path):
        height = box.lanes[place]
        dashed = "--" if box.passes[place].crossing is None else "-"
        before = path[n - 1][0] if n else box
        if before is not box and before.column == box.column:
            # Joints side by side are all reached from what they stand on.
            at = into
        into = at
        axis.plot([at[0], box.left], [at[1], height], color=line, lw=width, zorder=2)
        axis.plot([box.left, box.left + _BOX], [height, height], color=line, lw=width, ls=dashed, zorder=2)
        at = (box.left + _BOX, height)
        if n + 1 == len(path) or path[n + 1][0].column == box.column:
            axis.plot([at[0], at[0] + 0.14], [height, height], color=line, lw=width, zorder=2)
            axis.plot(at[0] + 0.14, height, "s", color=line, ms=4.5, zorder=3)


def _draw_table(axis: Axes, inst: FullForm, colours: Sequence[str], left: float, top: float) -> None:
    """Draw the moment arms of the straight joints: a row for each tendon, a column for each joint."""
    joints = (*inst.handle_joints[::-1], *inst.tip_joints)
    arms = np.hstack([straight_arms(inst, "handle")[:, ::-1], straight_arms(inst, "tip")])
    axis.text(left, top, "Moment arms of the straight joints, mm", weight="bold", va="top", fontsize=8.5)
    edges = list(np.cumsum([left + _name_width(inst), *(_column_width(joint) for joint in joints)]))
    y = top - 1.5 * _ROW
    for edge, joint in zip(edges[1:], joints, strict=True):
        axis.text(edge, y, joint.name, ha="right", va="center", fontsize=8, weight="bold")
    axis.plot([left, edges[-1]], [y - _ROW / 2] * 2, color=style.MUTED, lw=0.8)
    for tendon, row, colour in zip(inst.tendons, arms, colours, strict=True):
        y -= _ROW
        axis.text(left, y, tendon.name, va="center", fontsize=8, color=colour)
        for edge, arm in zip(edges[1:], row, strict=True):
            shown = "·" if arm == 0 else f"{1e3 * arm:+.3g}".replace("-", "−")
            axis.text(edge, y, shown, ha="right", va="center", fontsize=8)


def _table_width(inst: FullForm) -> float:
    columns = sum(_column_width(joint) for joint in inst.joints)
    return max(_name_width(inst) + columns, _LETTER * 36)


def _name_width(inst: FullForm) -> float:
    return _LETTER * max(len(tendon.name) for tendon in inst.tendons)


def _column_width(joint: Joint) -> float:
    return max(0.55, 0.2 + 1.05 * _LETTER * len(joint.name))


def _about(joint: Joint) -> str:
    axis = joint.axis if isinstance(joint.axis, str) else f"axis {', '.join(f'{x:.2g}' for x in joint.axis_vector)}"
    return f"{joint.mechanism}\n{axis}, {joint.range_text}°"


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g}"


def _wrapped(sentence: str, width: float) -> list[str]:
    return textwrap.wrap(sentence, int((width - 2 * _MARGIN) / 0.068))


def tendon_colours(count: int) -> list[str]:
    """Return a colour for each tendon."""
    named = [*mpl.color_sequences["tab10"], *mpl.color_sequences["Dark2"]]
    return [mpl.colors.to_hex(colour) for colour in named[:count]]
