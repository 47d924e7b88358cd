"""Controllers of all joints for the firmware: exported headers, and what their sensors showed in a closed loop.

    python firmware/joints.py FOLDER

Instruments of two, three and six joints move to a state over their range, then a force comes at the tip; their tendons
have 1.2 times the friction that the controller assumes. The loop is closed by the controller in double precision.
"""

import sys
from pathlib import Path

import numpy as np

from tenodesis.control import JointController, joints_header
from tenodesis.errors import InstrumentError
from tenodesis.files import atomic_file
from tenodesis.instrument import FullForm, expanded
from tenodesis.toml import validated
from tenodesis.twin import Twin

COEFFICIENT, BEND = 0.1, 0.35
SECONDS, STEP = 1.5, 5e-4
PULLEY, PASSED = 2.5e-3, 0.4e-3
"""Radius at which a tendon draws its own joint, and part of it by which it is drawn by each nearer one, m."""


def wrist(joints: int) -> FullForm:
    """Return pulleys one on another, pitch and yaw in turn, each with a pair of tendons that turns all nearer ones."""
    names = [f"j{i + 1}" for i in range(joints)]
    values = {
        "name": f"wrist-of-{joints}",
        "stem_diameter": "8 mm",
        "stem_length": "400 mm",
        "spool_radius": "2.5 mm",
        "pretension": "20 N",
        "tendon_stiffness": "100 N/mm",
        "joints": [
            {
                "name": name,
                "mechanism": "pulley",
                "axis": ("pitch", "yaw")[i % 2],
                "radius": PULLEY,
                "range": "60 deg",
                **({"on": names[i - 1], "offset": "8 mm"} if i else {}),
                **({"end_effector_length": "10 mm"} if name == names[-1] else {}),
            }
            for i, name in enumerate(names)
        ],
        "tendons": [
            {
                "name": f"{name}_{side}",
                "route": [
                    *({"joint": nearer, "side": side, "radius": PASSED} for nearer in names[:i]),
                    {"joint": name, "side": side},
                ],
            }
            for i, name in enumerate(names)
            for side in ("agonist", "antagonist")
        ],
    }
    return validated(FullForm, values, InstrumentError, "wrist")


def with_friction(inst: FullForm, times: float) -> FullForm:
    """Return an instrument whose sheaths and bends have friction, so many times as strong as is assumed."""
    own = dict.fromkeys(("sheath_coefficient", "vertex_coefficient"), COEFFICIENT * times)
    return inst.replace(friction={"law": "capstan", "sheath_bend": BEND, **own})


def inputs(inst: FullForm) -> bytes:
    """Return what a controller is given in a closed loop, tick by tick, as ``tenodesis_joints_input`` in float."""
    assumed, n = with_friction(inst, 1.0), len(inst.tip_joints)
    time = np.arange(round(SECONDS / STEP)) * STEP
    moved, loaded = (np.clip((time - start) / span, 0, 1)[:, np.newaxis] for start, span in ((0.1, 0.4), (0.7, 0.1)))
    moved = moved**2 * (3 - 2 * moved)
    handles = len(inst.handle_joints)
    handle = 0.3 * moved * np.ones(handles)
    target = 0.3 * moved * (-1.0) ** np.arange(n)
    arms, lengths = np.abs(inst.tendon_arms("tip")), [joint.end_effector_length or 0.0 for joint in inst.tip_joints]
    force = (
        float(np.max(arms.T @ inst.pretensions)) / 4 / (max(lengths) + sum(joint.offset for joint in inst.tip_joints))
    )
    run = Twin(with_friction(inst, 1.2), seed=1, quasi_static=True).run(
        handle,
        controller=JointController(assumed),
        wrench=loaded * np.array([force, -0.5 * force, 0, 0, 0, 0]),
        **({} if handles else {"target": target}),
    )
    rows = np.zeros(
        len(time),
        [
            ("time", "<u8"),
            ("request", "<u4"),
            ("reserved", "<u4"),
            ("handle_angle", "<f4", n),
            ("target", "<f4", n),
            ("tension", "<f4", len(inst.tendons)),
            ("spool_angle", "<f4", len(inst.tendons)),
        ],
    )
    rows["time"] = np.arange(1, len(time) + 1) * 500_000
    rows["request"][0] = 1
    if handles:
        rows["handle_angle"][1:, :handles] = run["measured_handle_angle"][:-1]
    else:
        rows["target"] = target
    # A tick sees what the step before has left; the first one sees the instrument at rest.
    rows["tension"] = np.vstack([inst.pretensions, run["measured_tension"][:-1]])
    rows["spool_angle"][1:] = run["measured_spool_angle"][:-1]
    size = rows.dtype.itemsize + -rows.dtype.itemsize % 8
    return b"".join(row.tobytes().ljust(size, b"\0") for row in rows)


def main() -> None:
    """Write headers and readings."""
    folder = Path(sys.argv[1])
    for joints, inst in ((2, expanded("real-size")), (3, expanded("needle-driver")), (6, wrist(6))):
        header = joints_header(with_friction(inst, 1.0), f"of_{joints}", own_clock=True, source=inst.name)
        path = folder / f"of_{joints}.h"
        with atomic_file(path) as new:
            new.write_text(header, "utf-8")
        with atomic_file(path.with_suffix(".in")) as new:
            new.write_bytes(inputs(inst))


if __name__ == "__main__":
    main()
