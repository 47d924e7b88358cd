"""Instruments of every mechanism and order of axes, for tests of kinematics."""

import pytest

import tenodesis as tn

from .conftest import EXAMPLES

REAL = tn.load("real-size")
INSTRUMENTS = {
    "real-size": REAL,
    "scaled-up": tn.load("scaled-up"),
    "pitch first": REAL.replace(axes=("pitch", "yaw"), geometry={"joint_spacing": 0.007, "stem_length": 0.25}),
    "pitch thicker": REAL.replace(overrides={"pitch": {"distal_gear_radius": 0.0025, "end_effector_length": 0.04}}),
    "pitch alone": REAL.replace(axes=("pitch",)),
    "pulley": tn.load(EXAMPLES / "pulley.toml").replace(axes=("yaw", "pitch")),
    "continuum": tn.load(EXAMPLES / "continuum.toml").replace(axes=("yaw", "pitch")),
}
every_instrument = pytest.mark.parametrize("inst", INSTRUMENTS.values(), ids=INSTRUMENTS)
