"""Instruments, motions and comparisons that tests of the twin share."""

from typing import Any

import numpy as np

import tenodesis as tn
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.twin import TIME_STEP, Twin

LAWS: dict[str, dict[str, Any]] = {
    "capstan": {"law": "capstan"},
    "constant": {"law": "capstan-constant", "constant": 0.2},
    "stribeck": {"law": "stribeck", "constant": 0.2, "static_ratio": 1.5},
    "viscous": {"law": "capstan", "viscous": 20.0},
}
SHARES = {"handle": 0.3, "handle_joint": 0.05, "tip_joint": 0.04, "anchor": 0.1}
AS_BUILT: dict[str, dict[str, Any]] = {
    "two vertices": {"vertices_per_joint": 2},
    "two vertices, four contacts": {"vertices_per_joint": 2, "sheath_contacts": 4},
    "base wrap": {"base_wrap": 0.2},
    "shares": {"vertices_per_joint": 2} | {f"{place}_compliance_share": share for place, share in SHARES.items()},
    "power": {"law": "capstan-power", "load_index": 0.7, "vertex_radius": 5e-4},
    "bending": {"vertices_per_joint": 2, "vertex_radius": 2e-3, "tendon_bending_stiffness": 2e-6},
}
QUIET = {"sensors.encoder_noise": 0.0, "sensors.load_cell_noise": 0.0}


def alone(inst: Instrument) -> Instrument:
    return inst.axis("yaw") if len(inst.axes) > 1 else inst


def smooth(inst: Instrument) -> Instrument:
    """The first axis without friction, as its file says it is."""
    return alone(inst).replace(friction=None, mismatch=None)


def with_friction(inst: Instrument, law: str = "capstan", **friction: Any) -> Instrument:
    """The first axis with friction at all contacts, by a law or as built."""
    rough = {"law": "capstan", "vertex_coefficient": 0.3, "sheath_coefficient": 0.15, "sheath_bend": 1.0}
    table = rough | (LAWS | AS_BUILT)[law] | friction
    return smooth(inst).replace(**{f"friction.{key}": value for key, value in table.items()})


def slack_force(inst: Instrument) -> float:
    return float(tn.statics.slack_force(inst, 0.0))


def handle(inst: Instrument, output_angle: float) -> float:
    return float(tn.statics.handle_angle(inst, output_angle))


def clock(duration: float, time_step: float = TIME_STEP) -> Array:
    return np.arange(1, round(duration / time_step) + 1) * time_step


def eased(to: float, duration: float, time_step: float = TIME_STEP) -> Array:
    """A command that leaves zero and arrives with zero velocity."""
    return to * (1 - np.cos(np.pi * clock(duration, time_step) / duration)) / 2


def settled(twin: Twin, handle_angle: float, duration: float = 2.5) -> Twin:
    """Move the handle there and wait until the tip rests."""
    twin.run(eased(handle_angle, 0.4, twin.time_step))
    twin.run(np.full(round(duration / twin.time_step), handle_angle))
    return twin


def same(one: Run, other: Run) -> None:
    for name, values in one.signals().items():
        np.testing.assert_array_equal(values, other.signals()[name], err_msg=name)


# Statics


def changes_with_finer_steps(inst: Instrument, duration: float) -> tuple[float, float]:
    """Return by how much the tip's motion (rad) changes from a 4th to a 16th of the time step, and to a 64th."""
    tips = []
    for times in (4, 16, 64):
        t = clock(duration, TIME_STEP / times)
        tips.append(Twin(inst, time_step=TIME_STEP / times).run(0.3 * np.sin(np.pi * t) ** 3).output_angle)
    return float(np.abs(tips[0] - tips[1][3::4]).max()), float(np.abs(tips[1] - tips[2][3::4]).max())
