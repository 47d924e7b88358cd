"""Instruments of several joints that tests share: axes of gears, jaws, a backbone in two segments, random ones."""

from typing import Any

import numpy as np

import tenodesis as tn
from tenodesis.instrument import FullForm, expanded
from tenodesis.statics import Status, chain
from tenodesis.toml import validated

SIDES = ["agonist", "antagonist", "middle"]
LISTED = tuple(name for name in tn.shipped() if tn.load(name).short_form is None)
"""Shipped instruments whose files list joints and tendons."""
GENTLE = 0.05  # rad: what each component of a load costs, about


def two_axes(name: str) -> FullForm:
    """Yaw and pitch of the paper's gears."""
    return expanded(tn.load(name).replace(axes=("yaw", "pitch")))


def jaws() -> FullForm:
    """Pitch and two jaws on pulleys; the jaws' tendons cross the pitch pulleys on one side each."""
    return tn.parse(_JAWS).expanded


def backbone() -> FullForm:
    """Two segments that bend at right angles; the tendons of the second pass the first out of its middle."""
    return tn.parse(_BACKBONE).expanded


def drawn(seed: int) -> FullForm:
    """Return a wrist with joints of any mechanism and axis, every one held by a pair that crosses the ones before."""
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 5))
    has_jaws = count > 1 and random.random() < 0.4
    joints: list[dict[str, Any]] = []
    for i in range(count):
        is_jaw = has_jaws and i >= count - 2
        mechanism = "pulley" if is_jaw else str(random.choice(["tendon-gear", "pulley", "continuum"]))
        axis: Any = "yaw" if is_jaw else str(random.choice(["yaw", "pitch"]))
        if mechanism == "pulley" and not is_jaw and random.random() < 0.5:
            axis = tuple(random.uniform(-1, 1, 3))
        joint = {"name": f"j{i}", "mechanism": mechanism, "axis": axis, "radius": random.uniform(2e-3, 5e-3)}
        joint["offset"] = random.uniform(0, 0.01)
        if mechanism == "continuum":
            joint |= {"backbone_length": random.uniform(0.01, 0.03), "backbone_rigidity": random.uniform(1e-4, 1e-3)}
            joint["arcs"] = 1
        if random.random() < 0.3:
            joint["stiffness"] = random.uniform(0.01, 0.1)
        if is_jaw:
            joint["on"] = "stem" if count == 2 else f"j{count - 3}"
        joint["end_effector_length"] = random.uniform(0.005, 0.03)
        joints.append(joint)
    tendons: list[dict[str, Any]] = []
    for i in range(count):
        crossed = range(min(i, count - 2) if has_jaws else i)
        passage = [
            {"joint": f"j{k}", "side": str(random.choice(SIDES)), "radius": random.uniform(1e-3, 3e-3)} for k in crossed
        ]
        for side in ("agonist", "antagonist"):
            route = [{"joint": f"h{i}", "side": side}, *passage, {"joint": f"j{i}", "side": side}]
            tendons.append({"name": f"t{i}_{side}", "route": route, "stiffness": random.uniform(1e4, 4e4)})
    wheels = [
        {"name": f"h{i}", "place": "handle", "mechanism": "pulley", "axis": "yaw", "radius": 4e-3} for i in range(count)
    ]
    values: dict[str, Any] = {"name": "drawn", "pretension": random.uniform(1, 8), "joints": [*wheels, *joints]}
    if has_jaws:
        values["grip"] = {"jaws": [f"j{count - 2}", f"j{count - 1}"], "length": 5e-3}
    return validated(FullForm, values | {"tendons": tendons}, tn.InstrumentError)


def holds(inst: FullForm) -> bool:
    """Whether all joints are held at rest; pretension that is not balanced may leave one loose."""
    return bool(chain.equilibrium(inst, np.zeros((1, len(inst.handle_joints)))).status[0] == Status.OK)


def brought_to_rest(inst: FullForm, wrench: list[float]) -> np.ndarray:
    """Assert that a wrench on a wrist at rest does the work that is stored and lost, and ends where the statics say.

    Returns the angles there.
    """
    still, loads = np.zeros((20000, len(inst.handle_joints))), np.tile(wrench, (20000, 1))
    energy = tn.twin.Twin(inst, time_step=1e-4).energy(still[:8000], wrench=loads[:8000])
    gained = energy.stored_after - energy.stored_before
    assert energy.load > 1e-5
    assert abs(gained - (energy.load + energy.spools - energy.friction - energy.damping)) <= 1e-5 * energy.load
    run = tn.twin.Twin(inst, time_step=1e-4).run(still, wrench=loads)
    rest = chain.output_angles(inst, still[0], wrench)
    np.testing.assert_allclose(run["output_angle"][-1], rest, atol=1e-4)
    return np.asarray(rest)


class Point:
    """Random handle angles of a wrist and a load that bends every joint a little."""

    def __init__(self, inst: FullForm, seed: int, scale: float = GENTLE) -> None:
        random = np.random.default_rng(seed)
        self.inst = inst
        rates = chain.rates(inst, 0.0)
        size = [np.abs(rates.by_wrench[:, part]).max() for part in (slice(0, 3), slice(3, 6))]
        self.handle = random.uniform(-0.3, 0.3, len(inst.handle_joints))
        self.wrench = scale * random.uniform(-1, 1, 6) / np.repeat(size, 3)
        self.grip = scale * random.uniform(-1, 1) / np.abs(rates.by_grip).max() if inst.grip else 0.0
        self.strokes = random.uniform(-1e-4, 1e-4, len(inst.tendons))

    def load(self, **changes: Any) -> dict[str, Any]:
        return {"wrench": self.wrench, "grip_force": self.grip, "strokes": self.strokes, **changes}


_JAWS = """
name = "jaws"
stem_length = "300 mm"
tendon_stiffness = "20 N/mm"
pretension = "12 N"
joints = [
  { name = "handle_pitch", place = "handle", mechanism = "pulley", axis = "pitch", radius = "5 mm" },
  { name = "handle_a", place = "handle", mechanism = "pulley", axis = "yaw", radius = "6 mm" },
  { name = "handle_b", place = "handle", mechanism = "pulley", axis = "yaw", radius = "6 mm" },
  { name = "pitch", mechanism = "pulley", axis = "pitch", radius = "3 mm" },
  { name = "jaw_a", on = "pitch", mechanism = "pulley", axis = "yaw", radius = "3.2 mm", offset = "9 mm", \
    end_effector_length = "10 mm" },
  { name = "jaw_b", on = "pitch", mechanism = "pulley", axis = "yaw", radius = "3.2 mm", offset = "9 mm", \
    end_effector_length = "10 mm" },
]
tendons = [
  { name = "pitch_up", route = [
    { joint = "handle_pitch", side = "agonist" }, { joint = "pitch", side = "agonist" }] },
  { name = "pitch_down", route = [
    { joint = "handle_pitch", side = "antagonist" }, { joint = "pitch", side = "antagonist" }] },
  { name = "a_open", route = [
    { joint = "handle_a", side = "agonist" }, { joint = "handle_pitch", side = "agonist", radius = "4 mm" },
    { joint = "pitch", side = "agonist", radius = "2.5 mm" }, { joint = "jaw_a", side = "agonist" }] },
  { name = "a_close", route = [
    { joint = "handle_a", side = "antagonist" }, { joint = "handle_pitch", side = "agonist", radius = "4 mm" },
    { joint = "pitch", side = "agonist", radius = "2.5 mm" }, { joint = "jaw_a", side = "antagonist" }] },
  { name = "b_close", route = [
    { joint = "handle_b", side = "agonist" }, { joint = "handle_pitch", side = "antagonist", radius = "4 mm" },
    { joint = "pitch", side = "antagonist", radius = "2.5 mm" }, { joint = "jaw_b", side = "agonist" }] },
  { name = "b_open", route = [
    { joint = "handle_b", side = "antagonist" }, { joint = "handle_pitch", side = "antagonist", radius = "4 mm" },
    { joint = "pitch", side = "antagonist", radius = "2.5 mm" }, { joint = "jaw_b", side = "antagonist" }] },
]
grip = { jaws = ["jaw_a", "jaw_b"], length = "8 mm" }
"""

_BACKBONE = """
name = "backbone"
tendon_stiffness = "8 N/mm"
pretension = "6 N"
joints = [
  { name = "wheel_far", place = "handle", mechanism = "pulley", axis = "pitch", radius = "5 mm" },
  { name = "wheel_near", place = "handle", mechanism = "pulley", axis = "yaw", radius = "5 mm" },
  { name = "near", mechanism = "continuum", axis = "yaw", radius = "3 mm", backbone_length = "20 mm", \
    backbone_rigidity = "300 N*mm^2", arcs = 1 },
  { name = "far", mechanism = "continuum", axis = "pitch", radius = "3 mm", backbone_length = "15 mm", \
    backbone_rigidity = "300 N*mm^2", arcs = 1, end_effector_length = "12 mm" },
]
tendons = [
  { name = "near_plus", route = [{ joint = "wheel_near", side = "agonist" }, { joint = "near", side = "agonist" }] },
  { name = "near_minus", route = [
    { joint = "wheel_near", side = "antagonist" }, { joint = "near", side = "antagonist" }] },
  { name = "far_plus", route = [
    { joint = "wheel_far", side = "agonist" }, { joint = "near", side = "agonist", radius = "1 mm" },
    { joint = "far", side = "agonist" }] },
  { name = "far_minus", route = [
    { joint = "wheel_far", side = "antagonist" }, { joint = "near", side = "agonist", radius = "1 mm" },
    { joint = "far", side = "antagonist" }] },
]
"""


def in_a_plane(lengths: tuple[float, float], friction: dict[str, Any] | None = None) -> FullForm:
    """Two pulleys of one axis in series; the second's tendons pass the first on one side each."""
    near, far = ({"name": f"j{i}", "mechanism": "pulley", "axis": "yaw", "radius": 4e-3} for i in (1, 2))
    far |= {"offset": lengths[0], "end_effector_length": lengths[1]}
    routes = [[("j1", "agonist")], [("j1", "antagonist")], [("j1", "agonist"), ("j2", "agonist")]]
    routes.append([("j1", "antagonist"), ("j2", "antagonist")])
    tendons = [
        {"name": f"t{m}", "route": [{"joint": joint, "side": side, "base_wrap": 0.3} for joint, side in route]}
        for m, route in enumerate(routes)
    ]
    values = {"name": "in-a-plane", "pretension": 12.0, "tendon_stiffness": 2e4, "joints": [near, far]}
    return validated(FullForm, values | {"tendons": tendons, "friction": friction or {}}, tn.InstrumentError)
