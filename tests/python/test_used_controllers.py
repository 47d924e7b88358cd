"""Claims about controllers that have run before, and about the warning of a run that faulted."""

import warnings

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import FaultWarning
from tenodesis.instrument import Instrument
from tenodesis.simulate import execute

from .conftest import refused

HANDLE = np.linspace(0, 0.3, 1000)


def controlled(inst: Instrument, controller: tn.control.Controller) -> tn.Run:
    return tn.twin.Twin(inst, seed=1).run(HANDLE, force=1.0, controller=controller)


def test_a_controller_that_ran_on_another_twin_is_refused_until_it_is_reset(scaled: Instrument) -> None:
    controller = tn.control.Controller(scaled)
    first = controlled(scaled, controller)
    with refused("controller"):
        controlled(scaled, controller)
    controller.reset()
    np.testing.assert_array_equal(controlled(scaled, controller).output_angle, first.output_angle)


def test_a_controller_goes_on_with_its_own_twin_as_in_one_run(scaled: Instrument) -> None:
    whole = controlled(scaled, tn.control.Controller(scaled))
    twin, controller = tn.twin.Twin(scaled, seed=1), tn.control.Controller(scaled)
    parts = [twin.run(part, force=1.0, controller=controller) for part in np.split(HANDLE, 4)]
    np.testing.assert_array_equal(np.concatenate([part["output_angle"] for part in parts]), whole.output_angle)


def test_a_controller_does_not_go_back_in_time_with_its_twin(scaled: Instrument) -> None:
    twin, controller = tn.twin.Twin(scaled, seed=1), tn.control.Controller(scaled)
    before = twin.state
    twin.run(HANDLE, controller=controller)
    twin.state = before
    with refused("controller"):
        twin.run(HANDLE, controller=controller)


def test_a_controller_that_was_stepped_elsewhere_is_refused(scaled: Instrument) -> None:
    controller = tn.control.Controller(scaled)
    controller.step(0.0, 0.0, [41.0, 41.0], [0.0, 0.0])
    with refused("controller"):
        controlled(scaled, controller)


def test_a_fault_is_warned_about_once_where_the_run_is_returned(scaled: Instrument) -> None:
    silent = scaled.replace(**{"sensors.load_cell_noise": 0.0})
    with pytest.warns(FaultWarning, match=r"faulted at .* s: load_cell_stuck; .* have no noise") as caught:
        tn.twin.Twin(silent).run(np.zeros(2000), controller=tn.control.Controller(scaled))
    assert caught[0].filename == __file__
    protocol = tn.simulate.parse('name = "still"\n[[phases]]\nkind = "hold"\nduration = "3 s"\n')
    with pytest.warns(FaultWarning) as caught:
        execute(tn.twin.Twin(silent), protocol, tn.control.Controller(scaled))
    assert len(caught) == 1


def test_a_run_without_a_fault_is_not_warned_about(scaled: Instrument) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        controlled(scaled, tn.control.Controller(scaled))
        silent = scaled.replace(**{"sensors.load_cell_noise": 0.0})
        controlled(silent, tn.control.Controller(silent))
