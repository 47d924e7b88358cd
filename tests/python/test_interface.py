"""The promised interface: every name is there, takes the arguments it is promised with, and returns what it should."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument


def test_instruments_are_loaded_parsed_and_replaced(tmp_path: Path) -> None:
    inst = tn.load("real-size").replace(pretension=41.3)
    assert inst.pretension == 41.3
    assert {"real-size", "scaled-up"} <= set(tn.shipped())
    path = tmp_path / "own.toml"
    path.write_text(tn_text(inst), "utf-8")
    assert tn.load(path) == tn.parse(path.read_text("utf-8")) == inst
    assert isinstance(inst, tn.TendonGear) and issubclass(tn.TendonPulley, tn.Instrument)
    assert issubclass(tn.Continuum, tn.Instrument)
    assert [one.axes for one in inst.planar] == [("yaw",), ("pitch",)]


def tn_text(inst: Instrument) -> str:
    from tenodesis.instrument.text import to_toml

    return to_toml(inst)


def test_statics_take_scalars_and_arrays(real: Instrument) -> None:
    angles = np.linspace(-0.3, 0.3, 5)
    s = tn.statics
    for value in (
        s.output_angle(real, 0.3, 1.0),
        s.handle_angle(real, 0.3, 1.0),
        s.torque_transmissibility(real, 0.3, 1.0),
        s.flexural_stiffness(real, 0.3),
        s.loss_of_dexterity(real, 0.3, 1.0),
        s.slack_force(real, 0.3),
        s.estimate_output_angle(real, 0.3, 32.0, 28.0, wound=0),
        s.compensation_stroke(real, 32.0, 28.0, actuation="agonist", law="exact"),
        s.compensation_stroke(real, 32.0, 28.0, actuation="differential", law="paper"),
        s.reach(real),
        s.gradient("output_angle", real, 0.3, 1.0, wrt=["pretension"])["pretension"],
    ):
        assert isinstance(value, float)
    agonist, antagonist = s.tensions(real, angles, 0.5)
    assert agonist.shape == antagonist.shape == s.output_angle(real, angles, 0.5).shape == angles.shape
    assert s.equilibrium(real, 0.3, 1.0).status == s.Status.OK


def test_similarity_compares(real: Instrument, scaled: Instrument) -> None:
    comparison = tn.similarity.compare(real, scaled)
    assert comparison.force_factor(0.1) > 0
    assert comparison.tension_factor > 0


def test_a_twin_runs_alone_with_a_controller_and_many_at_once(scaled: Instrument) -> None:
    run = tn.twin.Twin(scaled).run(np.zeros(20), force=0.1)
    assert isinstance(run, tn.Run) and len(run) == 20
    assert len(run.rows(5, 10)) == 5 and len(run.between(0.002, 0.004)) == 5 and run.axis("yaw") is run
    assert len(run[0.002:0.004]) == len(run[0:0.0025]) == 5 and len(run[::4]) == 5
    with pytest.raises(
        tn.errors.ArgumentError, match=r"run\[2:3\] could be rows or seconds; it must be run.rows\(2, 3\)"
    ):
        run[2:3]
    controller = tn.control.Controller(scaled, observer="friction", law="robust", actuation="differential")
    controlled = tn.twin.Twin(scaled).run(np.zeros(20), force=0.1, controller=controller)
    assert controlled["estimated_output_angle"].shape == (20,)
    out = tn.control.Controller(scaled).step(0.0, 0.0, tensions=(25.0, 25.0), spool_angles=(0.0, 0.0))
    assert out.spool_velocity.shape == (2,)
    batch = tn.twin.run_many(scaled, np.zeros(20), vary={"pretension": [20.0, 25.0]})
    assert batch["output_angle"].shape == (2, 20)


def test_one_contact_transmits() -> None:
    assert tn.tendon.transmit([10.0, 11.0, 10.0], 0.2, gain=1.0, initial=None).shape == (3,)


def test_the_rest_of_the_promised_names_are_there() -> None:
    for module, names in {
        tn: ("Recording", "Recorder", "set_threads", "Error", "InstrumentError", "NoSolutionError", "__version__"),
        tn.scaling: ("design", "load"),
        tn.kinematics: ("forward", "inverse", "jacobian", "frames", "workspace", "urdf", "mjcf", "Posture"),
        tn.control: ("Controller", "FAULTS", "OperatingState", "Request", "export_header"),
        tn.simulate: ("FaultInjection", "load", "parse"),
        tn.identification: ("fit",),
        tn.tolerance: ("study", "load"),
    }.items():
        for name in names:
            assert hasattr(module, name), f"{module.__name__}.{name}"
    assert set(tn.__all__) <= set(dir(tn))
    with pytest.raises(AttributeError):
        tn.absent  # noqa: B018


@pytest.mark.process
def test_the_package_and_an_instrument_import_without_heavy_libraries() -> None:
    code = "import sys, tenodesis as tn; tn.load; tn.statics; tn.twin; tn.simulate; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"pint", "matplotlib", "viser", "typst", "scipy", "mujoco"} & set(loaded)
