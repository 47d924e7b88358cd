"""The 3-D view of the instrument in a browser."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from trimesh import Trimesh

from tenodesis import kinematics
from tenodesis.console.assembly import DISC, Assembly, disc_place
from tenodesis.console.plots import TensionColours
from tenodesis.console.solids import Solid, rod, solids
from tenodesis.instrument import FullForm, Instrument
from tenodesis.kinematics import Frame, Frames
from tenodesis.kinematics.chain import skeleton
from tenodesis.run import Array

if TYPE_CHECKING:
    import viser

ROOT = "/instrument"
_HEAD_DOWN = (0.0, 1.0, 0.0, 0.0)
"""Half a turn about x: the tip, which points along z, is at the bottom of the picture, as in the patient."""
SIZE = 3.0
"""Length of every instrument in the units of the view."""
SHORT_STEM = 0.9
"""Largest length of the drawn stem over that of handle and end-effector, so that both ends fit into the picture."""
_TISSUE = (222, 184, 176)
_GHOST = (22, 134, 88)
_FORCE = (124, 58, 237)
_BACKBONE = (150, 158, 170)
_TENDON_PIXELS = 3.0
_VISIBLE = 1e-3
"""Smallest change that is sent, in the units of the view: a third of a pixel on a large screen."""
_HALF_TURN = 3.14  # rad


class Drawn(NamedTuple):
    """What the view shows at an instant; angles in rad, NaN where unknown."""

    handle: Array
    """Of the handle's joints, (handle joints,)."""
    output: Array
    """Of the tip's joints, (joints,)."""
    target: Array
    """The same where the ghost is."""
    tension: Array
    """At spool and tip of every tendon, (tendons, 2), N."""
    force: Array
    """On each end at which forces act, in its axes, (ends, 3), N."""


class Scene:
    """The 3-D view of an instrument in a browser.

    Parameters
    ----------
    client
        The browser.
    inst
        The instrument.
    largest_force
        Force of the longest arrow, N.
    parts
        Its parts, drawn instead of plain solids if they are its own.
    small
        Whether the screen is a phone's.
    """

    def __init__(
        self,
        client: "viser.ClientHandle",
        inst: Instrument,
        largest_force: float,
        *,
        parts: Assembly | None = None,
        small: bool = False,
    ) -> None:
        self._client, self._largest_force, self._small = client, largest_force, small
        self._inst = with_short_stem(inst)
        of = skeleton(self._inst)
        tip, stem, handle = extents(self._inst)
        self._scale = scale = SIZE / (tip + stem + handle)
        top = tip + of.insertion
        self._points = {
            "whole": (scale * ((tip + stem + handle) / 2 - top), 3.3),
            "tip": (scale * (0.55 * tip - top), 0.5 + 1.6 * scale * tip),
            "handle": (scale * (tip + stem + 0.4 * handle - top), 1.9),
        }
        self._sent: dict[str, Array] = {}
        with client.atomic():
            scene: Any = client.scene
            scene.reset()
            scene.configure_default_lights(enabled=True, cast_shadow=False)
            # Drawing an environment map takes half a minute without a graphics card.
            scene.configure_environment_map(hdri=None)
            scene.add_light_hemisphere("/light", sky_color=(255, 255, 255), ground_color=(150, 150, 160), intensity=2.4)
            scene.add_frame(ROOT, show_axes=False, wxyz=_HEAD_DOWN)
            if of.port is not None:
                self._port(scene)
            own = parts is not None and not parts.differs(inst)
            drawn = parts.of(inst, of.stem_length) if parts is not None and own else solids(self._inst)
            self._build(drawn, TensionColours(inst))

    def show(self, shown: Drawn) -> None:
        """Draw the instrument at an instant."""
        # One call for the instrument and for the ghost; what a load turns past its stop is drawn at half a turn.
        output = np.nan_to_num([shown.output, shown.target]).clip(-_HALF_TURN, _HALF_TURN)
        both = kinematics.frames(self._inst, output, np.nan_to_num(shown.handle))
        with self._client.atomic():
            frames = self._place_all(both, shown.tension)
            self._place_discs(frames)
            for name, line in self._backbones.items():
                points = self._scale * frames.backbones[name]
                if self._changed(f"{name} backbone", points):
                    line.points = _segments(points)
            for (name, arrow), force in zip(self._arrows.items(), np.nan_to_num(shown.force), strict=True):
                self._draw_force(name, arrow, force, self._largest_force)

    def write(self, text: str) -> None:
        """Show a text at the tip."""
        if self._label.text != text:
            self._label.text = text

    def look(self, name: str) -> None:
        """Turn the browser's camera to the entire instrument, its tip or its handle."""
        middle, away = self._points[name]
        camera = self._client.camera
        if self._small:
            # The panel of a phone covers the lower part of the picture.
            middle, away = middle - 1.03 * away, 2.3 * away
        with self._client.atomic():
            camera.position = (0.28 * away, -away, middle + 0.3 * away)
            camera.look_at = (0.0, 0.0, middle)

    def _build(self, solids: Sequence[Solid], colours: TensionColours) -> None:
        """Add bodies, the solids on them, tendons, backbones, forces, and the shadows of what the tip's joints turn."""
        of, rest = skeleton(self._inst), kinematics.frames(self._inst, 0.0)
        scene: Any = self._client.scene
        self.colours = colours
        self._bodies = {name: scene.add_frame(f"{ROOT}/{name}", show_axes=False) for name in rest.bodies}
        # Discs of a backbone are placed along it.
        discs = {solid.body for solid in solids if solid.body.startswith(DISC)}
        self._discs = {name: scene.add_frame(f"{ROOT}/{name}", show_axes=False) for name in discs}
        for solid in solids:
            self._add(scene, f"{ROOT}/{solid.body}/{solid.name}", solid.mesh, solid.colour, solid.opacity)
        turned = {f"{joint.name}_far" for joint in self._inst.tip_joints}
        turned |= {of.end(joint, kind) for joint in self._inst.tip_joints for kind in ("end_effector", "tip")}
        self._ghosts: dict[str, Any] = {}
        for solid in solids:
            if solid.body not in turned:
                continue
            if solid.body not in self._ghosts:
                self._ghosts[solid.body] = scene.add_frame(f"{ROOT}/ghost/{solid.body}", show_axes=False)
            self._add(scene, f"{ROOT}/ghost/{solid.body}/{solid.name}", solid.mesh, _GHOST, 0.3)
        self._tendons = {
            name: scene.add_line_segments(
                f"{ROOT}/tendons/{name}",
                points=_segments(self._scale * path),
                colors=np.zeros((len(path) - 1, 2, 3), np.uint8),
                thickness=_TENDON_PIXELS,
                thickness_units="screen",
            )
            for name, path in rest.tendons.items()
        }
        radii = {joint.name: joint.radius for joint in self._inst.joints}
        self._backbones = {
            name: scene.add_line_segments(
                f"{ROOT}/backbones/{name}",
                points=np.zeros((1, 2, 3)),
                colors=_BACKBONE,
                thickness=0.5 * self._scale * radii[name],
            )
            for name in rest.backbones
        }
        ends = [of.end(self._inst.tip_joints[end], "tip") for end in self._inst.bearing]
        self._arrows = {
            end: scene.add_arrows(
                f"{ROOT}/{end}/force",
                points=np.zeros((1, 2, 3)),
                colors=_FORCE,
                shaft_radius=0.014,
                head_radius=0.05,
                head_length=0.13,
                visible=False,
            )
            for end in ends
        }
        self._label = scene.add_label(f"{ROOT}/{ends[0]}/label", "", anchor="top-left", font_screen_scale=1.0)

    def _place_all(self, both: Frames, tension: Array) -> Frames:
        """Place bodies and tendons as the first of two rows of frames, and ghosts as the second.

        Tensions at spool and tip of every tendon, (tendons, 2), N, colour it. Returns the first row.
        """
        frames = Frames(
            {name: Frame(frame.position[0], frame.quaternion[0]) for name, frame in both.bodies.items()},
            {name: path[0] for name, path in both.tendons.items()},
            {name: path[0] for name, path in both.backbones.items()},
        )
        for name, frame in frames.bodies.items():
            self._place(name, self._bodies[name], frame)
        for name, node in self._ghosts.items():
            ghost = both.bodies[name]
            self._place(f"ghost {name}", node, Frame(ghost.position[1], ghost.quaternion[1]))
        for ends, (name, path) in zip(tension, frames.tendons.items(), strict=True):
            line = self._tendons[name]
            points = self._scale * path
            if self._changed(f"{name} points", points):
                line.points = _segments(points)
            # Friction acts at the joints; a linear change along the tendon looks the same.
            along = np.linspace(ends[0], ends[1], len(path))
            if self._changed(f"{name} tension", along / self.colours.limit, coarse=10):
                line.colors = _segments(_linear(self.colours(along)))
        return frames

    def _draw_force(self, name: str, arrow: Any, force: Array, largest: float) -> None:
        """Draw an arrow that pushes on its node with a force (3,); the largest force has the longest arrow."""
        size = float(np.linalg.norm(force))
        if not self._changed(f"{name} force", force / largest):
            return
        arrow.visible = size > 1e-3
        if size > 1e-3:
            way = force / size
            arrow.points = np.stack([-(0.25 + 0.4 * size / largest) * way, -0.05 * way])[np.newaxis]

    def _add(self, scene: Any, name: str, mesh: Trimesh, colour: tuple[int, int, int], opacity: float | None) -> None:
        scene.add_mesh_simple(
            name,
            vertices=self._scale * mesh.vertices,
            faces=mesh.faces,
            color=colour,
            opacity=opacity,
            flat_shading=True,
            side="double",
        )

    def _place(self, name: str, node: Any, frame: Frame) -> None:
        place = self._scale * frame.position
        if self._changed(f"{name} position", place):
            node.position = place
        if self._changed(f"{name} quaternion", frame.quaternion):
            node.wxyz = frame.quaternion

    def _changed(self, name: str, value: Array, *, coarse: float = 1.0) -> bool:
        """Return whether a value differs visibly from the last value sent, and if so keep it as sent."""
        before = self._sent.get(name)
        if before is not None and np.abs(np.nan_to_num(value) - before).max() < coarse * _VISIBLE:
            return False
        self._sent[name] = np.nan_to_num(value)
        return True

    def _place_discs(self, frames: Frames) -> None:
        if not self._discs:
            return
        begin, near, arcs = 0.0, frames.bodies["stem"], []
        for joint in self._inst.tip_joints:
            far = frames.bodies[f"{joint.name}_far"]
            arcs.append((begin, near, far, joint.chord))
            begin, near = begin + joint.chord, far
        for name, node in self._discs.items():
            along = float(name.removeprefix(DISC))
            # The last arc that begins before it.
            begin, near, far, length = [one for one in arcs if one[0] <= along][-1]
            self._place(name, node, disc_place(near, far, along - begin, length))

    def _port(self, scene: Any) -> None:
        """Draw the wall of the body around the port."""
        radius = (self._inst.stem_diameter or 0.0) / 2
        wall = rod(0.45 * SIZE / self._scale / 2, -0.1 * radius, 0.1 * radius, 64)
        self._add(scene, f"{ROOT}/port/wall", wall, _TISSUE, 0.35)
        self._add(scene, f"{ROOT}/port/ring", rod(1.5 * radius, -0.9 * radius, 0.9 * radius, 32), (96, 106, 120), 0.9)


def extents(inst: Instrument) -> tuple[float, float, float]:
    """Return the lengths of tip, stem and handle of the straight instrument, m."""
    of = skeleton(inst)
    heights = [float(frame.position[2]) - of.insertion for frame in kinematics.frames(inst, 0.0).bodies.values()]
    return max(heights), of.stem_length, max(0.0, -of.stem_length - min(heights))


def with_short_stem(inst: Instrument) -> FullForm:
    """Return an instrument as joints and tendons to be drawn, with a stem short enough for the picture."""
    of = skeleton(inst)
    tip, stem, handle = extents(inst)
    thick = (kinematics.parts.parts(inst, "urdf")[0].cylinder or (0.0,) * 3)[2]
    # What is not drawn has its defaults.
    changes: dict[str, Any] = dict.fromkeys(("friction", "sensors", "drives", "control", "conditions", "devices"))
    changes |= {"stem_length": min(stem, SHORT_STEM * (tip + handle)), "stem_diameter": 2 * thick}
    return of.inst.replace(**changes, geometry=None if of.port is None else {"jaw_length": of.port.jaw_length})


def _segments(path: Any) -> Any:
    """Return the segments (n - 1, 2, 3) between the points of a path (n, 3)."""
    return np.stack([path[:-1], path[1:]], 1)


def _linear(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return colours of lines in the viewer's linear colour space."""
    return (255 * (colours / 255) ** 2.2).round().astype(np.uint8)


def in_degrees(angle: float) -> str:
    """Return an angle, in degrees, as text."""
    # Zero has no minus sign.
    return f"{round(angle, 1) + 0.0:+.1f}°" if np.isfinite(angle) else "unknown"
