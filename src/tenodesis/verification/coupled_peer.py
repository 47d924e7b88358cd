"""An independent check of joints that share tendons, built from their description and settled in MuJoCo.

Nothing here uses the statics of the core: gears are two hinges tied to each other, pulleys are cylinders that strings
wrap around, a backbone is a row of vertebrae, strings pull and never push, forces act at sites, and the angles are
wherever the mechanism comes to rest. All quantities are in SI units (m, N, rad). Straight, the instrument lies along z,
tip up.
"""

from dataclasses import dataclass
from itertools import product
from math import nan
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.coupled import CoupledInstrument, Joint, Tendon
from tenodesis.extras import require
from tenodesis.verification.mujoco_peer import RATE, TIME_STEP, relax

Array = NDArray[np.float64]

_VERTEBRAE = 8  # that an elastic backbone is divided into
_LAG = 0.01  # s: all motions decay at this rate, since every spring has its damper
_SIDES = {"agonist": 1.0, "antagonist": -1.0, "middle": 0.0}
_STEM = 0.1  # m, where a file gives none; its length has no part in an equilibrium
_WRENCH = ("1 0 0 0 0 0", "0 1 0 0 0 0", "0 0 1 0 0 0", "0 0 0 1 0 0", "0 0 0 0 1 0", "0 0 0 0 0 1")


@dataclass(frozen=True)
class Settled:
    """Equilibrium: angles of the tip's joints (rad) and tensions of the tendons (N), all NaN if there is none."""

    angles: Array
    tensions: Array
    steps: int


class CoupledPeer:
    """A coupled instrument in MuJoCo; raises MissingExtraError if MuJoCo is not installed.

    A pulley's tendons wrap around it by a quarter turn while it is straight, so that they leave it where its joint is
    bent by a right angle.
    """

    def __init__(self, inst: CoupledInstrument) -> None:
        self._mujoco = require("mujoco", "verify")
        self._inst = inst
        self._model = self._mujoco.MjModel.from_xml_string(coupled_xml(inst))
        self._data = self._mujoco.MjData(self._model)
        self._mujoco.mj_forward(self._model, self._data)
        self._rest = self._data.ten_length - inst.pretensions / inst.stiffnesses
        self._hinges = [[self._model.joint(name).qposadr[0] for name in _hinges(joint)] for joint in inst.tip_joints]

    def settle(
        self,
        handle_angles: ArrayLike,
        wrench: ArrayLike = (0.0,) * 6,
        *,
        grip_force: float = 0.0,
        strokes: ArrayLike = 0.0,
        axes: str = "tip",
    ) -> Settled:
        """Let the instrument come to rest, first unloaded and then under its load; arguments as in `tn.coupled`.

        The grip force acts between the jaws: opposite forces there have a moment about the jaws' axis and no sum.
        """
        mujoco, model, data, inst = self._mujoco, self._model, self._data, self._inst
        mujoco.mj_resetData(model, data)
        for joint, angle in zip(inst.handle_joints, np.asarray(handle_angles, float), strict=True):
            half = angle / len(_hinges(joint)) / 2
            for name in _hinges(joint):
                model.body(name).quat = (np.cos(half), *np.sin(half) * np.array(joint.axis_vector))
        model.tendon_lengthspring[:, 1] = self._rest - strokes
        steps = 0
        for share in (0.0, 1.0):
            load = share * np.asarray(wrench, float) / len(inst.bearing)
            own, fixed = (load, 0 * load) if axes == "tip" else (0 * load, load)
            data.ctrl[:] = np.tile(np.concatenate([own, fixed]), len(inst.bearing))
            for jaw, sign in zip(inst.jaws, (1.0, -1.0), strict=False):
                length = (inst.grip and inst.grip.length) or inst.tip_joints[jaw].end_effector_length or 0.0
                data.qfrc_applied[self._hinges[jaw]] = share * sign * length * grip_force
            taken, resting = relax(mujoco, model, data)
            steps += taken
            if not resting:
                return Settled(np.full(len(self._hinges), nan), np.full(len(inst.tendons), nan), steps)
        angles = np.array([data.qpos[hinges].sum() for hinges in self._hinges])
        stretch = data.ten_length - model.tendon_lengthspring[:, 1]
        return Settled(angles, model.tendon_stiffness * stretch.clip(min=0.0), steps)


def coupled_xml(inst: CoupledInstrument) -> str:
    """Write the MuJoCo model (MJCF) of an instrument with its handle straight."""
    root = Element("mujoco", model="joints that share tendons")
    SubElement(root, "compiler", angle="radian")
    SubElement(root, "option", timestep=f"{TIME_STEP}", integrator="implicitfast", gravity="0 0 0")
    default = SubElement(root, "default")
    SubElement(default, "equality", solref=f"{2 * TIME_STEP} 1", solimp="0.9999 0.9999 0.001 0.5 2")
    SubElement(default, "geom", type="cylinder", contype="0", conaffinity="0", mass="0")
    world = SubElement(root, "worldbody")
    SubElement(world, "site", name="stem")
    tendons, ties = SubElement(root, "tendon"), SubElement(root, "equality")
    loads = SubElement(root, "actuator")

    bottom = SubElement(world, "body", name="stem_bottom")
    top = SubElement(world, "body", name="stem_top", pos=f"0 0 {inst.stem_length or _STEM}")
    links: dict[str, _Link] = {}
    on = bottom
    for joint in inst.handle_joints:
        links[joint.name] = link = _Link(joint, on, -1.0)
        on = link.far
    stiffness = _joint_stiffnesses(inst)
    for place, joint in enumerate(inst.tip_joints):
        parent = inst.parents[place]
        on = top if parent < 0 else links[inst.tip_joints[parent].name].far
        links[joint.name] = link = _Link(joint, on, 1.0)
        link.free(stiffness[place], ties)
    for end in inst.bearing:
        joint = inst.tip_joints[end]
        SubElement(links[joint.name].far, "site", name=joint.name, pos=_vector((0, 0, joint.end_effector_length or 0)))
        for reference, gear in product(({}, {"refsite": "stem"}), _WRENCH):
            SubElement(loads, "motor", {"site": joint.name, "gear": gear, **reference})
    for tendon, of_tendon in zip(inst.tendons, inst.stiffnesses, strict=True):
        # A range of rest lengths that starts at zero makes a string: it pulls, and never pushes.
        string = SubElement(tendons, "spatial", name=tendon.name, springlength="0 1")
        string.set("stiffness", f"{of_tendon}")
        string.set("damping", f"{_LAG * of_tendon}")
        _thread(tendon, inst, links, string)
    indent(root)
    return tostring(root, encoding="unicode")


class _Link:
    """Bodies of a joint, from the one that it stands on to its far end; `up` is -1 where it points to the handle."""

    def __init__(self, joint: Joint, on: Element, up: float) -> None:
        self.joint, self.up = joint, up
        self.axis = np.array(joint.axis_vector)
        along = np.array([0.0, 0.0, 1.0]) if abs(self.axis[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
        self.side = np.cross(self.axis, along)  # to which a positive angle bends
        self.side /= np.linalg.norm(self.side)
        self.ahead = up * np.cross(self.side, self.axis)
        names = _hinges(joint)
        if joint.mechanism == "continuum":
            pitch = joint.chord / len(names)
            # In the proportions of Gregory's rule the row reaches as far as the arc, but for a high order of its bends.
            inner = [pitch] * (len(names) - 3)
            steps, rest = [5 / 12 * pitch, 13 / 12 * pitch, *inner, 13 / 12 * pitch], 5 / 12 * pitch
        else:
            steps, rest = [joint.chord * k for k in range(len(names))], 0.0
        steps[0] += joint.offset
        self.heights = [up * step for step in steps]  # of every hinge in the body before it
        self.bodies = [on]
        for name, height in zip(names, self.heights, strict=True):
            self.bodies.append(SubElement(self.bodies[-1], "body", name=name, pos=f"0 0 {height}"))
        self.far = self.bodies[-1]
        if rest:
            self.far = SubElement(self.far, "body", name=f"{joint.name}_far", pos=f"0 0 {up * rest}")

    def free(self, stiffness: float, ties: Element) -> None:
        """Let the joint turn; its stiffness (N m/rad) only serves to choose inertia that suits the time step."""
        names, own = _hinges(self.joint), self.joint.own_stiffness
        for name, body in zip(names, self.bodies[1:], strict=True):
            hinge = SubElement(body, "joint", name=name, axis=_vector(self.axis))
            for key, value in {
                "armature": stiffness / RATE**2,
                "stiffness": own,
                "damping": _LAG * own,
            }.items():
                hinge.set(key, f"{len(names) * value}")
            body.insert(0, Element("inertial", pos="0 0 0", mass="1e-6", diaginertia="1e-9 1e-9 1e-9"))
            if name != names[0]:
                SubElement(ties, "joint", joint1=name, joint2=names[0])

    def guide(self, tendon: str, side: float, radius: float) -> list[tuple[Element, str, dict[str, str]]]:
        """Add what leads a tendon over the joint: body, element of the string and its attributes, outward."""
        out = side * self.side
        if self.joint.mechanism == "tendon-gear":
            ends = (self.bodies[0], self.heights[0]), (self.bodies[-1], 0.0)
            return [
                _site(body, f"{tendon}_{k}_{self.joint.name}", radius * out + (0, 0, z))
                for k, (body, z) in enumerate(ends)
            ]
        route = []
        for near, far, height in zip(self.bodies, self.bodies[1:], self.heights, strict=False):
            name, centre = f"{tendon}_{far.get('name')}", np.array([0, 0, height])
            if not side:
                route += [_site(near, f"{name}_in", centre), _site(far, f"{name}_out", 0 * centre)]
                continue
            SubElement(
                near, "geom", name=name, pos=_vector(centre), zaxis=_vector(self.axis), size=f"{radius} {radius}"
            )
            SubElement(near, "site", name=f"{name}_side", pos=_vector(centre + 3 * radius * (out + self.ahead)))
            # It comes along the link, wraps by a quarter turn, and leaves across the next one.
            route += [
                _site(near, f"{name}_in", centre + radius * (out - self.ahead)),
                (near, "geom", {"geom": name, "sidesite": f"{name}_side"}),
                _site(far, f"{name}_out", radius * (self.ahead - out)),
            ]
        return route


def _thread(tendon: Tendon, inst: CoupledInstrument, links: dict[str, _Link], string: Element) -> None:
    """Lead a tendon over its joints from the handle's end to the tip."""
    crossings = {crossing.joint: crossing for crossing in tendon.route}
    before: Element | None = None
    for joint in (*reversed(inst.handle_joints), *inst.tip_joints):
        if joint.name not in crossings:
            continue
        crossing, link = crossings[joint.name], links[joint.name]
        radius = joint.radius if crossing.radius is None else crossing.radius
        route = link.guide(tendon.name, _SIDES[crossing.side], radius)
        if link.up < 0:
            route.reverse()
        if before is not None and route[0][0] is not before and before.get("name") != "stem_bottom":
            # It does not cross what is between: there it runs at a constant length.
            SubElement(string, "pulley", divisor="1")
        for _, kind, attributes in route:
            SubElement(string, kind, attributes)
        before = route[-1][0]


def _hinges(joint: Joint) -> list[str]:
    """Return the names of a joint's hinges, which share its angle equally."""
    count = {"tendon-gear": 2, "pulley": 1, "continuum": _VERTEBRAE}[joint.mechanism]
    return [f"{joint.name}_{k}" for k in range(count)]


def _joint_stiffnesses(inst: CoupledInstrument) -> list[float]:
    """Return about how stiff each straight joint is, N m/rad."""
    found = {joint.name: joint.own_stiffness for joint in inst.tip_joints}
    for tendon, stiffness in zip(inst.tendons, inst.stiffnesses, strict=True):
        for crossing in tendon.route:
            if crossing.joint in found and crossing.side != "middle":
                radius = crossing.radius or next(j.radius for j in inst.tip_joints if j.name == crossing.joint)
                found[crossing.joint] += float(stiffness) * radius**2
    return list(found.values())


def _site(body: Element, name: str, at: Array) -> tuple[Element, str, dict[str, str]]:
    SubElement(body, "site", name=name, pos=_vector(at))
    return body, "site", {"site": name}


def _vector(values: ArrayLike) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values, float))
