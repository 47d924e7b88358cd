"""An instrument as the core's chain: its joints, where its tendons pass them, the port, and the names of its bodies."""

from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis.instrument import FullForm, Instrument, InstrumentLike, Joint, Tendon, as_instrument, expanded
from tenodesis.instrument.joints import MECHANISMS, SIGNS
from tenodesis.kinematics.dimensions import PortRange, port_range

Array: TypeAlias = NDArray[np.float64]

STEM = 0.1
"""Length of the stem where a file gives none, m."""
_Z = np.array([0.0, 0.0, 1.0])


class Skeleton(NamedTuple):
    """An instrument in space: joints and tendons, the port where its file gives one, and the core's chain of them."""

    given: Instrument
    """As its file has it."""
    inst: FullForm
    port: PortRange | None
    stem_length: float
    core: _core.Chain

    @property
    def insertion(self) -> float:
        """Of the stem at rest, m; without a port its tip end is the origin."""
        return 0.0 if self.port is None else self.port.at_rest

    @property
    def rolls(self) -> bool:
        """Whether the end-effector rolls about itself: behind a port, where there is one."""
        return self.port is not None and self._single("tip")

    def end(self, joint: Joint, kind: str) -> str:
        """Return the name of a body beyond a joint: tip, grip or end_effector."""
        alone = self.port is not None and self._single(joint.place)
        return kind if alone else f"{joint.name}_{kind}"

    def around(self, joint: Joint) -> Joint | None:
        """Return the joint that a joint bends within."""
        return next((other for other in self.inst.tip_joints if other.name == joint.within), None)

    def inside(self, joint: Joint) -> Joint | None:
        """Return the joint that bends within a joint."""
        return next((other for other in self.inst.tip_joints if other.within == joint.name), None)

    def _single(self, place: str) -> bool:
        return sum(joint.place == place and end_length(self.inst, joint) is not None for joint in self.inst.joints) == 1

    @property
    def bodies(self) -> dict[str, int]:
        """Place of each body among the core's frames, by its name."""
        found = {"stem": 0}
        for at_tip, joints in ((True, self.inst.tip_joints), (False, self.inst.handle_joints)):
            for place, joint in enumerate(joints):
                first = 1 + 4 * place if at_tip else 1 + 4 * len(self.inst.tip_joints) + 3 * place
                # A pulley turns about one axis, and nothing is between its ends.
                if joint.mechanism != "pulley":
                    found[f"{joint.name}_carrier"] = first
                if self.inside(joint) is not None:
                    continue
                found[f"{joint.name}_far"] = first + 1
                if end_length(self.inst, joint) is None:
                    continue
                if at_tip and self.rolls:
                    found[self.end(joint, "end_effector")] = first + 2
                found[self.end(joint, "tip" if at_tip else "grip")] = first + (3 if at_tip else 2)
        return found


def skeleton(given: InstrumentLike) -> Skeleton:
    """Return an instrument in space.

    Raises
    ------
    TypeError, InstrumentError
        It is none, or its lengths leave no stem.
    """
    return _skeleton(as_instrument(given))


@lru_cache(maxsize=64)
def _skeleton(given: Instrument) -> Skeleton:
    inst = expanded(given)
    stem = inst.stem_length or given.geometry.stem_length or STEM
    # The short form has a port, the other where its file has the table of it.
    has_port = inst is not given or "geometry" in given.model_fields_set
    reach = max(end_length(inst, inst.tip_joints[end]) or 0.0 for end in inst.ends)
    port = port_range(given, stem, reach) if has_port else None
    tips, handles = inst.tip_joints, inst.handle_joints
    tip, handle = _joints(inst, tips, inst.parents), _joints(inst, handles, tuple(range(-1, len(handles) - 1)))
    places = {joint.name: place for joints in (tips, handles) for place, joint in enumerate(joints)}
    routes = [
        [(joint.place == "tip", places[joint.name], *offset.tolist()) for joint, offset in crossed(inst, tendon)]
        for tendon in inst.tendons
    ]
    return Skeleton(given, inst, port, stem, _core.Chain(tip, handle, stem, routes))


def _joints(
    inst: FullForm, joints: tuple[Joint, ...], parents: tuple[int, ...]
) -> tuple[list[int], list[int], list[list[float]]]:
    numbers = [
        [
            *joint.axis_vector,
            joint.offset,
            1.0 if joint.within else joint.chord,
            end_length(inst, joint) or 0.0,
            float(joint.within is not None),
        ]
        for joint in joints
    ]
    return [MECHANISMS[joint.mechanism] for joint in joints], list(parents), numbers


def end_length(inst: FullForm, joint: Joint) -> float | None:
    """Return how far beyond a joint forces act or, if none do, a jaw holds an object, m."""
    held = inst.grip.length if inst.grip is not None and joint.name in inst.grip.jaws else None
    return held if joint.end_effector_length is None else joint.end_effector_length


def bend_side(axis_vector: tuple[float, float, float]) -> Array:
    """Return the unit vector (3,) to which a positive angle about an axis bends: that of the agonist."""
    axis = np.array(axis_vector)
    along = _Z if abs(axis[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    side = np.cross(axis, along)
    return np.asarray(side / np.linalg.norm(side))


def crossed(inst: FullForm, tendon: Tendon) -> list[tuple[Joint, Array]]:
    """Return the joints that a tendon crosses, from the handle's end to the tip, and its offset from their middle.

    The offset (3,), m, is in the link before. In a joint's middle plane a tendon runs as far along the joint's axis as
    at the next joint outward that it bends.
    """
    crossings = {crossing.joint: crossing for crossing in tendon.route}
    # From the stem outward at either end, last first.
    handles = [joint for joint in reversed(inst.handle_joints) if joint.name in crossings]
    tips = [joint for joint in reversed(inst.tip_joints) if joint.name in crossings]
    found: dict[str, Array] = {}
    for outward in (handles, tips):
        beyond = np.zeros(3)
        for joint in outward:
            crossing, axis = crossings[joint.name], np.array(joint.axis_vector)
            radius = joint.radius if crossing.radius is None else crossing.radius
            offset = SIGNS[crossing.side or "middle"] * radius * bend_side(joint.axis_vector)
            if crossing.side == "middle":
                found[joint.name] = (beyond @ axis) * axis
            else:
                found[joint.name] = beyond = offset
    for joint in tips:
        if joint.within in found:
            # Two planes of the same arc: the tendon runs at the distances in both.
            sides = [name for name in (joint.name, joint.within) if crossings[name].side != "middle"]
            if sides:
                found[joint.name] = found[joint.within] = np.sum([found[name] for name in sides], axis=0)
    return [(joint, found[joint.name]) for joint in (*handles, *reversed(tips))]


def rotated(quaternion: Array, vector: Array) -> Array:
    """Return vectors (..., 3) turned by unit quaternions (..., 4)."""
    w, u = quaternion[..., :1], quaternion[..., 1:]
    twice = 2 * np.cross(u, vector)
    return np.asarray(vector + w * twice + np.cross(u, twice))
