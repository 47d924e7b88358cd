"""Homing finds the load cells' offsets and the difference of their gains, and the controller corrects them."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.simulate import FaultInjection
from tenodesis.twin import Twin

from .test_homing_proof import home_on, inject

# The instruments and a load at the tip below their force limits, N.
INSTRUMENTS = {"scaled-up": 1.4, "real-size": 0.5}
SECOND = 2000  # ticks


def estimate_after_homing(name: str, faults: list[FaultInjection], slack: float, homes: bool) -> tuple[float, float]:
    """Return the tip's error and the estimate's own (deg) with a loaded tip, the friction known."""
    inst = tn.load(name).axis("yaw")
    inst = inst.replace(tendon_stiffness=inst.tendon_stiffness * inst.mismatch.stiffness_ratio, mismatch=None)
    twin = Twin(inst, seed=4)
    if slack:
        twin.loosen(slack)
    controller = Controller(inst, homed=not homes)
    if homes:
        home_on(twin, controller, faults=faults)
        controller.ask("resume")
    handle = float(tn.statics.handle_angle(inst, np.radians(67)))
    rise = np.clip(np.arange(10 * SECOND) / (2 * SECOND), 0, 1)
    force = np.where(np.arange(10 * SECOND) < 3 * SECOND, 0.0, INSTRUMENTS[name])
    run = twin.run(handle * rise, force, controller=controller, fault_injection=faults)
    assert not run["faults"][-1]
    last = run.rows(-SECOND)
    error = last["output_angle"].mean() - np.radians(67)
    off = (last["estimated_output_angle"] - last["output_angle"]).mean()
    return float(np.degrees(error)), float(np.degrees(off))


CELLS = {
    "gains": inject(("tension.agonist", "scale", 1.02), ("tension.antagonist", "scale", 0.98)),
    "offsets": inject(("tension.agonist", "add", -0.5), ("tension.antagonist", "add", 0.5)),
    "both offsets": inject(("tension.agonist", "add", 0.5), ("tension.antagonist", "add", 0.5)),
}


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("slack", [0.0, 1e-3])
@pytest.mark.parametrize("kind", CELLS)
def test_after_homing_errors_of_the_cells_take_no_angle(name: str, slack: float, kind: str) -> None:
    error, off = estimate_after_homing(name, CELLS[kind], slack, homes=True)
    assert abs(off) < 0.3
    assert abs(error) < 0.7


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_without_homing_offsets_take_more(name: str) -> None:
    homed, not_homed = (estimate_after_homing(name, CELLS["offsets"], 0.0, homes=homes)[1] for homes in (True, False))
    assert abs(not_homed) > 2 * abs(homed)


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_strokes_find_what_gains_take_without_homing(name: str) -> None:
    error, off = estimate_after_homing(name, CELLS["gains"], 0.0, homes=False)
    assert abs(off) < 0.7
    assert abs(error) < 0.7


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_homing_again_judges_the_cells_anew(name: str) -> None:
    inst = tn.load(name).axis("yaw")
    twin = Twin(inst, seed=5)
    controller = Controller(inst, homed=False)
    home_on(twin, controller, faults=CELLS["gains"])
    assert home_on(twin, controller)["homing_failure"][-1] == 0
    controller.ask("resume")
    run = twin.run(np.zeros(2 * SECOND), controller=controller)
    off = run["estimated_output_angle"][-SECOND:] - run["output_angle"][-SECOND:]
    assert abs(np.degrees(off.mean())) < 0.3
