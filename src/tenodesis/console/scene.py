"""The 3-D view of the instrument in a browser."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from trimesh import Trimesh

from tenodesis import kinematics
from tenodesis.console.assembly import DISC, Assembly, disc_place
from tenodesis.console.display import ShownSignals
from tenodesis.console.plots import TensionColours
from tenodesis.console.solids import Solid, end_effector, rod, solids
from tenodesis.instrument import ShortForm
from tenodesis.kinematics import Dimensions, Frame, Frames, Posture
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
# Phases in which the tip is left behind on purpose.
_HELD_BACK = {4.0: ", restrained", 5.0: ", at the force limit"}


class View:
    """The 3-D view in a browser, of whatever instrument; :meth:`show` moves it.

    Parameters
    ----------
    client
        The browser.
    scale
        Units of the view per metre.
    points
        Height that the camera looks at, and its distance, by name, in the units of the view.
    small
        Whether the screen is a phone's.
    """

    def __init__(
        self,
        client: "viser.ClientHandle",
        scale: float,
        points: Mapping[str, tuple[float, float]],
        *,
        small: bool = False,
    ) -> None:
        self._client, self._scale, self._points, self._small = client, scale, points, small
        self._sent: dict[str, Array] = {}
        scene: Any = client.scene
        scene.reset()
        scene.configure_default_lights(enabled=True, cast_shadow=False)
        # Drawing an environment map takes half a minute without a graphics card.
        scene.configure_environment_map(hdri=None)
        scene.add_light_hemisphere("/light", sky_color=(255, 255, 255), ground_color=(150, 150, 160), intensity=2.4)
        scene.add_frame(ROOT, show_axes=False, wxyz=_HEAD_DOWN)

    def show(self, shown: Any) -> None:
        """Draw the instrument at an instant."""
        raise NotImplementedError

    def show_angles(self, shown: Any, *, recorded: bool) -> None:
        """Show angles as text, which takes longer to draw than what moves."""

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

    def _build(self, rest: Frames, solids: Iterable[Solid], ghosts: Iterable[Solid], colours: TensionColours) -> None:
        """Add bodies, the solids on them, tendons, and the shadows of solids on bodies that are placed as ghosts."""
        scene: Any = self._client.scene
        self.colours = colours
        self._bodies = {name: scene.add_frame(f"{ROOT}/{name}", show_axes=False) for name in rest.bodies}
        for solid in solids:
            self._add(scene, f"{ROOT}/{solid.body}/{solid.name}", solid.mesh, solid.colour, solid.opacity)
        self._ghosts: dict[str, Any] = {}
        for solid in ghosts:
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

    def _backbone(self, name: str, diameter: float) -> Any:
        """Add the line of a backbone of a diameter, m."""
        scene: Any = self._client.scene
        return scene.add_line_segments(
            f"{ROOT}/backbones/{name}",
            points=np.zeros((1, 2, 3)),
            colors=_BACKBONE,
            thickness=0.5 * self._scale * diameter,
        )

    def _arrow(self, name: str) -> Any:
        """Add the arrow of a force, hidden."""
        scene: Any = self._client.scene
        return scene.add_arrows(
            f"{ROOT}/{name}",
            points=np.zeros((1, 2, 3)),
            colors=_FORCE,
            shaft_radius=0.014,
            head_radius=0.05,
            head_length=0.13,
            visible=False,
        )

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

    def _draw_backbone(self, name: str, line: Any, path: Array) -> None:
        """Draw a backbone along points (n, 3), m."""
        if self._changed(f"{name} backbone", self._scale * path):
            line.points = _segments(self._scale * path)

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


class Scene(View):
    """The 3-D view of an instrument of planar axes.

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
        inst: ShortForm,
        largest_force: float,
        *,
        parts: Assembly | None = None,
        small: bool = False,
    ) -> None:
        self._inst, self._largest_force = with_short_stem(inst), largest_force
        lengths = self._lengths = kinematics.dimensions(self._inst)
        reach, grip = lengths.end_effector_length, lengths.handle_length
        scale = SIZE / (lengths.stem_length + grip + reach)
        port_to_hand = lengths.stem_length - lengths.insertion
        points = {
            "whole": (scale * (port_to_hand + grip - lengths.insertion - reach) / 2, 3.3),
            "tip": (scale * (-lengths.insertion - 0.45 * reach), 1.4),
            "handle": (scale * (port_to_hand + 0.4 * grip), 1.9),
        }
        with client.atomic():
            super().__init__(client, scale, points, small=small)
            scene: Any = client.scene
            self._port(scene)
            rest = self._frames(np.zeros(len(inst.axes)), np.zeros(len(inst.axes)))
            drawn, ghosts = solids(self._inst, lengths), end_effector(lengths)
            if parts is not None and not parts.differs(inst):
                drawn = parts.of(inst, lengths.stem_length)
                ghosts = [solid for solid in drawn if solid.body == f"{inst.axes[0]}_far"]
            # Discs of a backbone are placed along it.
            self._discs = {
                solid.body: scene.add_frame(f"{ROOT}/{solid.body}", show_axes=False)
                for solid in drawn
                if solid.body.startswith(DISC)
            }
            self._build(rest, drawn, ghosts, TensionColours(inst))
            self._backbones = {axis: self._backbone(axis, lengths.stem_diameter) for axis in rest.backbones}
            self._arrows = {axis: self._arrow(f"tip/force_{axis}") for axis in inst.axes}
            self._label = scene.add_label(f"{ROOT}/tip/label", "", anchor="top-left", font_screen_scale=1.0)

    def show(self, shown: ShownSignals) -> None:
        """Draw the instrument at an instant."""
        # One call for the instrument and for the ghost, which has the target angles.
        handle, output = np.nan_to_num(shown.handle), np.nan_to_num([shown.output, shown.target])
        both = self._frames(np.stack([handle, handle]), output)
        with self._client.atomic():
            tension = np.stack([shown.tension, shown.distal_tension], -1).reshape(-1, 2)
            frames = self._place_all(both, tension)
            self._place_discs(frames)
            for axis, line in self._backbones.items():
                self._draw_backbone(axis, line, frames.backbones[axis])
            for number, (axis, arrow) in enumerate(self._arrows.items()):
                force = float(np.nan_to_num(shown.force[number]) + np.nan_to_num(shown.contact_force[number]))
                # It pushes on the tip against positive flexion, and turns with the tip.
                way = np.array([-1.0, 0.0, 0.0]) if axis == "yaw" else np.array([0.0, -1.0, 0.0])
                self._draw_force(axis, arrow, force * way, self._largest_force)

    def _place_discs(self, frames: Frames) -> None:
        stem, far = frames.bodies["stem"], frames.bodies[f"{self._inst.axes[0]}_far"]
        length = getattr(self._inst, "backbone_length", 0.0)
        for name, node in self._discs.items():
            self._place(name, node, disc_place(stem, far, float(name.removeprefix(DISC)), length))

    def show_angles(self, shown: ShownSignals, *, recorded: bool) -> None:
        """Show tip angles and targets as text, which takes longer to draw than what moves."""
        rows = zip(self._inst.axes, np.degrees(shown.output), np.degrees(shown.target), shown.phase, strict=True)
        forces = zip(self._inst.axes, shown.estimated_force, 2 * shown.force_deviation, strict=True)
        angles = [
            (axis, in_degrees(output), in_degrees(target) + _HELD_BACK.get(phase, ""))
            for axis, output, target, phase in rows
        ]
        if len(angles) == 1:
            lines = [f"{axis} {output}\ntarget {target}" for axis, output, target in angles]
        else:
            lines = ["tip, target", *(f"{axis} {output}, {target}" for axis, output, target in angles)]
        lines += [f"{axis} force {force:+.1f} ± {width:.1f} N" for axis, force, width in forces if np.isfinite(width)]
        text = "\n".join(["recorded:", *lines] if recorded else lines)
        if self._label.text != text:
            self._label.text = text

    def _frames(self, handle: Array, output: Array) -> Frames:
        """Return where everything is at handle and output angles (..., axes), rad."""
        angles: dict[str, Any] = {axis: output[..., n] for n, axis in enumerate(self._inst.axes)}
        angles |= {f"handle_{axis}": handle[..., n] for n, axis in enumerate(self._inst.axes)}
        return kinematics.frames(self._inst, Posture(insertion=self._lengths.insertion, **angles))

    def _port(self, scene: Any) -> None:
        """Draw the wall of the body around the port."""
        radius = self._lengths.stem_diameter / 2
        wall = rod(0.45 * SIZE / self._scale / 2, -0.1 * radius, 0.1 * radius, 64)
        self._add(scene, f"{ROOT}/port/wall", wall, _TISSUE, 0.35)
        self._add(scene, f"{ROOT}/port/ring", rod(1.5 * radius, -0.9 * radius, 0.9 * radius, 32), (96, 106, 120), 0.9)


def with_short_stem(inst: ShortForm) -> ShortForm:
    """Return an instrument with a stem short enough for the picture."""
    lengths: Dimensions = kinematics.dimensions(inst)
    short = SHORT_STEM * (lengths.handle_length + lengths.end_effector_length)
    if lengths.stem_length <= short:
        return inst
    shares = {"insertion": None, "least_insertion": None, "most_insertion": None, "stem_length": short}
    return inst.replace(**{f"geometry.{key}": value for key, value in shares.items()})


def _segments(path: Any) -> Any:
    """Return the segments (n - 1, 2, 3) between the points of a path (n, 3)."""
    return np.stack([path[:-1], path[1:]], 1)


def _linear(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return colours of lines in the viewer's linear colour space."""
    return (255 * (colours / 255) ** 2.2).round().astype(np.uint8)


def in_degrees(angle: float, digits: int = 1) -> str:
    """Return an angle, in degrees, as text."""
    # Zero has no minus sign.
    return f"{round(angle, digits) + 0.0:+.{digits}f}°" if np.isfinite(angle) else "unknown"
