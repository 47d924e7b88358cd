"""Pictures of the assembly and of its parts apart: shaded by a depth buffer, with the names of the parts."""

import math
from collections.abc import Collection, Mapping, Sequence
from itertools import cycle
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import Placed, assembled
from tenodesis.cad.lever_parts import Lever
from tenodesis.cad.model import Model
from tenodesis.cad.wrist_parts import Jaw
from tenodesis.report import style
from tenodesis.run import Array

_HALF_OPEN = math.radians(20)
_COLOURS = ("#5f7f9e", "#c98a4b", "#6d9a75", "#9c7bb0", "#b86a6a", "#7a8b99", "#b59f5a", "#5f9a9a")
_BOUGHT = "#b4bcc4"
_LIGHT = np.array([-0.2, 0.93, 0.3])
_EYE = (-0.62, 0.72, 0.33)
"""Direction toward the eye: from above, and from the side that the tip bends away from."""
_Buffers: TypeAlias = tuple[Array, NDArray[np.int64], Array]
_Colours: TypeAlias = Mapping[str, tuple[float, float, float]]
_FINE = 2  # samples per pixel and direction
_EDGE = 0.35
_NAME = 72.0  # pt, of a part's name in small type
_LETTER = 4.2  # pt, of a letter of it
_HIGH = 220.0  # pt, of a picture
_LINE = 15.0  # pt, of its line


def draw_assembly(model: Model, output_angle: float = math.radians(40)) -> Figure:
    """Return a picture of the whole assembly, its tip bent to an angle (rad), and of both ends; a jaw half closed."""
    tips, hands, full = model.at(tip=True), model.at(tip=False), model.instrument.expanded
    opens, angles = np.sign(full.grip_arms), []
    for (first, *_), (_, most) in zip(full.bends.values(), full.bend_limits, strict=True):
        sizes = tips[first].sizes
        usual = float(opens[first]) * _HALF_OPEN if isinstance(sizes, Jaw) else min(output_angle, most)
        angles.append(sizes.closed / 2 if isinstance(sizes, Lever) else usual)
    placed = assembled(model, full.bent(angles))
    # The load rig follows the first joint alone.
    loaded = assembled(model, full.bent([angles[0], *(0.0 for _ in angles[1:])]))
    fig = style.StyledFigure(figsize=(11.0, 7.2), layout="constrained")
    panels = fig.subplot_mosaic("AA;BC" if hands else "AA;BB", height_ratios=(0.62, 1.0), width_ratios=(1.0, 1.25))
    whole, tip = panels["A"], panels["B"]
    close = {one.part.name for end in (True, False) if model.at(tip=end) for one in _near(model, placed, tip=end)}
    groups = dict.fromkeys(one.part.name for one in placed if one.part.name == "grip" or one.part.name not in close)
    colours = colours_of(model)
    _show(whole, loaded, colours, groups, "Assembly on its bench", (2200, 780))
    _show(
        tip,
        _near(model, placed, tip=True),
        colours,
        None,
        f"Tip, bent by {math.degrees(output_angle):.0f}°",
        (1000, 350) if hands else (1400, 780),
    )
    if hands:
        title = "Joint of the handle" if len(tips) == 1 else "Joints of the handle"
        _show(panels["C"], _near(model, placed, tip=False), colours, None, title, (1000, 430))
    return fig


def draw_exploded(model: Model) -> Figure:
    """Return a picture of the parts of both joints, and of the load rig and drives, moved apart."""
    placed = assembled(model, 0.0, exploded=1.0)
    bench = [one for one in placed if one.part.body in ("bench", "rig_bar") and one.number == 0]
    rig = [one for one in bench if one.part.name.startswith("rig_")]
    drives = [one for one in bench if one not in rig]
    wide = {
        "Tip, apart": _near(model, placed, tip=True),
        "Handle, apart": _near(model, placed, tip=False) if model.at(tip=False) else [],
    }
    narrow = {"Load rig, apart, one of each kind": rig, "Drive, apart": drives}
    rows: list[Any] = [[title, title] for title, group in wide.items() if group]
    below = [title for title, group in narrow.items() if group]
    rows += [[below[0], below[-1]]] if below else []
    heights = [*(1.0, 0.9)[: len(rows) - bool(below)], *([1.2] if below else [])]
    fig = style.StyledFigure(figsize=(11.0, 10.5 * sum(heights) / 3.1), layout="constrained")
    panels = fig.subplot_mosaic(rows, height_ratios=heights, width_ratios=(1.9, 1.0))
    for title, axis in panels.items():
        points = 780 if title in wide or len(below) == 1 else 510 if title == below[0] else 270
        _show(axis, (wide | narrow)[title], colours_of(model), None, title, (1400, points))
    return fig


def _near(model: Model, placed: Sequence[Placed], *, tip: bool) -> list[Placed]:
    """Return what belongs to one end: its joint and what is fixed to it."""
    other = tuple(f"{one.end.prefix}_" for one in model.at(tip=not tip))
    other += ("grip",) if tip else ("end_effector", "backbone")
    return [
        one
        for one in placed
        if one.part.body not in ("bench", "rig_bar")
        and one.part.name not in ("stem", "stem_base", "tip_force_pin")
        and not one.part.name.startswith(other)
    ]


def _show(  # noqa: PLR0917
    axis: Axes,
    placed: Sequence[Placed],
    colours: _Colours,
    names: Collection[str] | None,
    title: str,
    width: tuple[int, float],
) -> None:
    """Draw parts on an axis, at a width in pixels that is so many points; `names` are those to name, None for all."""
    axis.set_axis_off()
    axis.set_title(title, loc="left", pad=24)
    image, centres = rendered(placed, colours, width[0])
    high, wide = image.shape[:2]
    axis.imshow(image, interpolation="antialiased", aspect="equal")
    kinds: dict[str, tuple[float, float]] = {}
    for one, centre in zip(placed, centres, strict=True):
        if centre is not None and (names is None or one.part.name in names):
            kinds.setdefault(one.part.name, centre)
    points = min(width[1], _HIGH * wide / high)
    needed = max(_NAME, _LETTER * max(map(len, kinds), default=0))
    flat = wide > 1.5 * high and (len(kinds) + 1) // 2 * needed <= points
    line = max(0.06, _LINE * wide / (points * high))
    _name(axis, kinds, (wide, high), needed / points if flat else line, across=0 if flat else 1)


def _name(
    axis: Axes, kinds: Mapping[str, tuple[float, float]], size: tuple[int, int], gap: float, *, across: int
) -> None:
    """Write names of parts above and below a picture (across = 0), or left and right (1), a share of it apart."""
    along = 1 - across
    # Half of the names on either side, by where their parts are across the picture.
    ranked = sorted(kinds, key=lambda name: kinds[name][along])
    for side in (-1, 1):
        chosen = ranked[: (len(ranked) + 1) // 2] if side < 0 else ranked[(len(ranked) + 1) // 2 :]
        chosen = sorted(chosen, key=lambda name: kinds[name][across])
        spread = _spread([kinds[name][across] for name in chosen], size[across], gap)
        for number, name in enumerate(chosen):
            place = [0.0, 0.0]
            place[across] = spread[number]
            place[along] = -0.06 * size[along] if side < 0 else 1.06 * size[along]
            axis.annotate(
                name,
                kinds[name],
                (place[0], place[1]),
                fontsize=7,
                ha="center" if across == 0 else ("right" if side < 0 else "left"),
                va="center" if across == 1 else ("bottom" if side < 0 else "top"),
                annotation_clip=False,
                arrowprops={"arrowstyle": "-", "lw": 0.5, "color": style.INK, "shrinkA": 1, "shrinkB": 0},
            )


def _spread(places: Sequence[float], size: float, share: float) -> list[float]:
    """Return places in ascending order, within a size, at least a share of it apart where there is room."""
    gap = min(share, 1 / max(len(places), 1)) * size
    found: list[float] = []
    for place in places:
        found.append(max(place, found[-1] + gap if found else gap / 2))
    for number in reversed(range(len(found))):
        most = size - gap / 2 if number + 1 == len(found) else found[number + 1] - gap
        found[number] = min(found[number], most)
    return found


def rendered(placed: Sequence[Placed], colours: _Colours, width: int) -> tuple[Array, list[tuple[float, float] | None]]:
    """Return an image (rows, columns, 3) of parts, and the pixel at the middle of what is seen of each, if any."""
    toward = np.array(_EYE) / np.linalg.norm(_EYE)
    # Along the page lies the stem.
    along = np.array([0.0, 0.0, 1.0]) - toward[2] * toward
    along /= np.linalg.norm(along)
    up = np.cross(toward, along)
    turn = np.stack([along, up, toward])
    meshes = [k.meshed(one.solid, 0.1, 0.3) for one in placed]
    seen = [k.Mesh(mesh.points @ turn.T, mesh.faces) for mesh in meshes]
    everything = np.vstack([mesh.points for mesh in seen])
    low, high = everything.min(0), everything.max(0)
    columns = width * _FINE
    scale = 0.98 * columns / (high[0] - low[0])
    if scale * (high[1] - low[1]) > 1.1 * columns:
        scale = 1.1 * columns / (high[1] - low[1])
    rows = int(scale * (high[1] - low[1]) * 1.02) + 4
    columns = int(scale * (high[0] - low[0]) * 1.02) + 4
    depth = np.full((rows, columns), -np.inf)
    owner = np.full((rows, columns), -1)
    normal = np.zeros((rows, columns, 3))
    for number, mesh in enumerate(seen):
        flat = mesh.points.copy()
        flat[:, 0] = (flat[:, 0] - low[0]) * scale + 2
        flat[:, 1] = rows - 2 - (flat[:, 1] - low[1]) * scale
        _fill(flat, mesh.faces, _normals(mesh), number, (depth, owner, normal))
    image = _shaded(placed, colours, (depth, owner, normal), turn @ _LIGHT, scale)
    centres: list[tuple[float, float] | None] = []
    for number in range(len(placed)):
        at_rows, at_columns = np.nonzero(owner == number)
        if at_rows.size < 12:
            centres.append(None)
            continue
        middle = np.argmin((at_rows - at_rows.mean()) ** 2 + (at_columns - at_columns.mean()) ** 2)
        centres.append((float(at_columns[middle]) / _FINE, float(at_rows[middle]) / _FINE))
    return _reduced(image), centres


def _normals(mesh: k.Mesh) -> Array:
    first, second, third = (mesh.points[mesh.faces[:, column]] for column in range(3))
    found = np.cross(second - first, third - first)
    lengths = np.linalg.norm(found, axis=1, keepdims=True)
    normals: Array = found / np.where(lengths > 0, lengths, 1)
    return normals


def _fill(flat: Array, faces: NDArray[np.intp], normals: Array, number: int, buffers: _Buffers) -> None:
    """Write the triangles of a part that face the eye to the buffers of depth, part and normal."""
    depth, owner, normal = buffers
    for face, way in zip(faces[normals[:, 2] > 0], normals[normals[:, 2] > 0], strict=True):
        (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = flat[face]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0:
            continue
        left, right = max(math.floor(min(x0, x1, x2)), 0), min(math.ceil(max(x0, x1, x2)) + 1, depth.shape[1])
        top, bottom = max(math.floor(min(y0, y1, y2)), 0), min(math.ceil(max(y0, y1, y2)) + 1, depth.shape[0])
        x, y = np.arange(left, right)[np.newaxis, :], np.arange(top, bottom)[:, np.newaxis]
        second = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) / area
        third = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) / area
        at = z0 + second * (z1 - z0) + third * (z2 - z0)
        window = (slice(top, bottom), slice(left, right))
        nearer = (second >= 0) & (third >= 0) & (second + third <= 1) & (at > depth[window])
        depth[window][nearer] = at[nearer]
        owner[window][nearer] = number
        normal[window][nearer] = way


def colours_of(model: Model) -> _Colours:
    """Return the colour of every part by name, red, green and blue from 0 to 1; bought parts are grey."""
    colours = cycle(_COLOURS)
    return {part.name: to_rgb(next(colours) if part.made else _BOUGHT) for part in model.parts}


def _shaded(placed: Sequence[Placed], colours: _Colours, buffers: _Buffers, light: Array, scale: float) -> Array:
    depth, owner, normal = buffers
    palette = np.array([*(colours[one.part.name] for one in placed), (1.0, 1.0, 1.0)])
    bright = np.clip(0.55 + 0.45 * (normal @ light), 0, 1)
    image = palette[owner] * np.where(owner >= 0, bright, 1.0)[..., np.newaxis]
    edge = np.zeros(owner.shape, bool)
    finite = np.where(np.isfinite(depth), depth, -1e6)
    for shift in (0, 1):
        other = np.roll(owner, 1, shift) != owner
        step = np.abs(np.roll(finite, 1, shift) - finite) > 6 / scale + 0.4
        bend = np.einsum("ijk,ijk->ij", np.roll(normal, 1, shift), normal) < 0.75
        edge |= other | (step & bend) | (bend & (owner >= 0))
    image[edge] *= _EDGE
    found: Array = image
    return found


def _reduced(image: Array) -> Array:
    rows, columns = (size // _FINE * _FINE for size in image.shape[:2])
    parts = image[:rows, :columns].reshape(rows // _FINE, _FINE, columns // _FINE, _FINE, 3)
    found: Array = np.clip(parts.mean((1, 3)), 0, 1)
    return found
