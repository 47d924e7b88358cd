"""Coupled instruments that tests share: two axes of gears, jaws behind a pitch pulley, a backbone in two segments."""

import tenodesis as tn
from tenodesis.coupled import CoupledInstrument, of_planar, parse


def two_axes(name: str) -> CoupledInstrument:
    """Yaw and pitch of the paper's gears."""
    return of_planar(tn.load(name).replace(axes=("yaw", "pitch")))


def jaws() -> CoupledInstrument:
    """Pitch and two jaws on pulleys; the jaws' tendons cross the pitch pulleys on one side each."""
    return parse(_JAWS)


def backbone() -> CoupledInstrument:
    """Two segments that bend at right angles; the tendons of the second pass the first out of its middle."""
    return parse(_BACKBONE)


_JAWS = """
name = "jaws"
stem_length = "300 mm"
tendon_stiffness = "20 N/mm"
pretension = "12 N"

[[joints]]
name = "handle_pitch"
place = "handle"
mechanism = "pulley"
axis = "pitch"
radius = "5 mm"

[[joints]]
name = "handle_a"
place = "handle"
mechanism = "pulley"
axis = "yaw"
radius = "6 mm"

[[joints]]
name = "handle_b"
place = "handle"
mechanism = "pulley"
axis = "yaw"
radius = "6 mm"

[[joints]]
name = "pitch"
mechanism = "pulley"
axis = "pitch"
radius = "3 mm"

[[joints]]
name = "jaw_a"
on = "pitch"
mechanism = "pulley"
axis = "yaw"
radius = "3.2 mm"
offset = "9 mm"
end_effector_length = "10 mm"

[[joints]]
name = "jaw_b"
on = "pitch"
mechanism = "pulley"
axis = "yaw"
radius = "3.2 mm"
offset = "9 mm"
end_effector_length = "10 mm"

[[tendons]]
name = "pitch_up"
route = [{ joint = "handle_pitch", side = "agonist" }, { joint = "pitch", side = "agonist" }]

[[tendons]]
name = "pitch_down"
route = [{ joint = "handle_pitch", side = "antagonist" }, { joint = "pitch", side = "antagonist" }]

[[tendons]]
name = "a_open"
route = [
  { joint = "handle_a", side = "agonist" },
  { joint = "handle_pitch", side = "agonist", radius = "4 mm" },
  { joint = "pitch", side = "agonist", radius = "2.5 mm" },
  { joint = "jaw_a", side = "agonist" },
]

[[tendons]]
name = "a_close"
route = [
  { joint = "handle_a", side = "antagonist" },
  { joint = "handle_pitch", side = "agonist", radius = "4 mm" },
  { joint = "pitch", side = "agonist", radius = "2.5 mm" },
  { joint = "jaw_a", side = "antagonist" },
]

[[tendons]]
name = "b_close"
route = [
  { joint = "handle_b", side = "agonist" },
  { joint = "handle_pitch", side = "antagonist", radius = "4 mm" },
  { joint = "pitch", side = "antagonist", radius = "2.5 mm" },
  { joint = "jaw_b", side = "agonist" },
]

[[tendons]]
name = "b_open"
route = [
  { joint = "handle_b", side = "antagonist" },
  { joint = "handle_pitch", side = "antagonist", radius = "4 mm" },
  { joint = "pitch", side = "antagonist", radius = "2.5 mm" },
  { joint = "jaw_b", side = "antagonist" },
]

[grip]
jaws = ["jaw_a", "jaw_b"]
length = "8 mm"
"""

_BACKBONE = """
name = "backbone"
tendon_stiffness = "8 N/mm"
pretension = "6 N"

[[joints]]
name = "wheel_far"
place = "handle"
mechanism = "pulley"
axis = "pitch"
radius = "5 mm"

[[joints]]
name = "wheel_near"
place = "handle"
mechanism = "pulley"
axis = "yaw"
radius = "5 mm"

[[joints]]
name = "near"
mechanism = "continuum"
axis = "yaw"
radius = "3 mm"
backbone_length = "20 mm"
backbone_rigidity = "300 N*mm^2"

[[joints]]
name = "far"
mechanism = "continuum"
axis = "pitch"
radius = "3 mm"
backbone_length = "15 mm"
backbone_rigidity = "300 N*mm^2"
end_effector_length = "12 mm"

[[tendons]]
name = "near_plus"
route = [{ joint = "wheel_near", side = "agonist" }, { joint = "near", side = "agonist" }]

[[tendons]]
name = "near_minus"
route = [{ joint = "wheel_near", side = "antagonist" }, { joint = "near", side = "antagonist" }]

[[tendons]]
name = "far_plus"
route = [
  { joint = "wheel_far", side = "agonist" },
  { joint = "near", side = "agonist", radius = "1 mm" },
  { joint = "far", side = "agonist" },
]

[[tendons]]
name = "far_minus"
route = [
  { joint = "wheel_far", side = "antagonist" },
  { joint = "near", side = "agonist", radius = "1 mm" },
  { joint = "far", side = "antagonist" },
]
"""
