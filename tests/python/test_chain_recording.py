"""Recordings and protocols of several joints: joints and tendons by name."""

import json
from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import ProtocolError, RecordingError
from tenodesis.recording import Recorder, Recording, tables
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record, write_run
from tenodesis.recording.summary import facts
from tenodesis.simulate import Cycles, GrippedObject, Hold, Protocol, Ramp, StepLoad, Wrench
from tenodesis.statics.bends import Bends

from .chain_samples import LISTED
from .conftest import EXAMPLES, Command, refused


def protocol(*phases: object) -> Protocol:
    return Protocol(name="test", phases=phases)


@pytest.fixture(scope="module")
def wrist() -> tn.instrument.FullForm:
    return tn.instrument.expanded("hybrid-scaled-up")


@pytest.fixture(scope="module")
def run(wrist: tn.instrument.FullForm) -> tn.Run:
    return tn.simulate.execute(tn.twin.Twin(wrist, seed=3), tn.simulate.load(EXAMPLES / "joints_protocol.toml"))


@pytest.mark.parametrize("name", LISTED)
def test_the_default_protocol_moves_loads_and_grips_and_comes_back_bit_by_bit(name: str, tmp_path: Path) -> None:
    inst = tn.load(name)
    plan = tn.simulate.default_protocol(inst)
    run = record(inst, plan, tmp_path / "run.mcap", seed=1, time_step=2e-3, quasi_static=True)
    bends = Bends.of(tn.instrument.expanded(inst))
    assert (np.abs(bends.summed(run["output_angle"])).max(axis=0) > np.radians(8)).all()
    across = run["force"] if run.wrench is None else run["wrench"][:, :2]
    assert set(np.unique(np.sign(across))) == {-1, 0, 1}
    assert inst.grip is None or run["grip_force"].max() > 0.1
    back = Recording.open(tmp_path / "run.mcap")
    assert back.instrument() == inst
    assert back.run.signals().keys() == run.signals().keys()
    assert (back.run.joints, back.run.handle_joints, back.run.tendons) == (run.joints, run.handle_joints, run.tendons)
    for signal in ("time", *run.signals()):
        there, again = ((one.time if signal == "time" else one[signal]) for one in (run, back.run))
        assert np.array_equal(there, again), signal
    again = tn.simulate.execute(
        tn.twin.Twin(inst, seed=1, time_step=2e-3, quasi_static=True), tn.simulate.parse(back.metadata["protocol"])
    )
    assert all(np.array_equal(again[signal], run[signal]) for signal in run.signals())
    assert replay(back).exact


def test_a_recording_names_joints_tendons_units_and_meanings(run: tn.Run, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    wrist = tn.instrument.expanded("hybrid-scaled-up")
    write_run(run, wrist, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        channels = {one.topic: one.metadata for one in make_reader(file).get_summary().channels.values()}
    tip = channels["/twin/tip/measured_js"]
    assert tip["signals"].split() == ["output_angle", "output_velocity", "contact_force"]
    assert tip["units"].split() == ["rad", "rad/s", "N"]
    assert tip["meanings"].startswith("Output angle of the end-effector; Its rate; ")
    load = channels["/rig/wrench"]
    assert dict(zip(load["signals"].split(), load["units"].split(), strict=True))["wrench.mz"] == "N*m"
    metadata = Recording.open(tmp_path / "run.mcap").metadata
    assert metadata["joints"].split() == ["yaw", "pitch", "jaw"]
    assert metadata["tendons"].split()[-1] == "grip"


def test_a_controllers_estimates_and_faults_are_recorded_by_joint(
    wrist: tn.instrument.FullForm, tmp_path: Path
) -> None:
    controller = tn.control.Controller(tn.control.compensated(wrist))
    load = StepLoad(wrench=Wrench(fy=0.5), duration=0.1)
    run = record(wrist, protocol(load), tmp_path / "run.mcap", controller=controller)
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.run.columns("estimated_force") == run.compensated == ("yaw", "pitch")
    assert recording.run.signals().keys() == run.signals().keys()
    assert all(np.array_equal(recording.run[signal], run[signal], equal_nan=True) for signal in run.signals())
    said = facts(recording)
    assert said["controller"] == "robust law, friction observer, differential actuation, of yaw and pitch"
    assert said["faults"] == "none"
    winding = Ramp(duration=0.1, spool_velocities={"yaw_agonist": 0.1})
    with pytest.raises(ProtocolError, match="spool_velocities is given for yaw_agonist; with a controller"):
        record(wrist, protocol(winding), tmp_path / "no.mcap", controller=controller)
    assert not (tmp_path / "no.mcap").exists()


def test_tables_have_a_column_for_each_joint_and_tendon(run: tn.Run, tmp_path: Path) -> None:
    few = run.rows(last=50)
    columns = tables.columns(few)
    assert np.array_equal(columns["output_angle.pitch [rad]"], few["output_angle.pitch"])
    assert np.array_equal(columns["wrench.mz [N*m]"], few["wrench.mz"])
    assert np.array_equal(columns["grip_force [N]"], few["grip_force"])
    tables.to_csv(few, tmp_path / "run.csv")
    header, *rows = (tmp_path / "run.csv").read_text("utf-8").splitlines()
    assert len(rows) == 50
    assert "tension.yaw_agonist [N]" in header.split(",")


def test_a_run_of_other_joints_is_refused_in_a_sentence(run: tn.Run, tmp_path: Path) -> None:
    other = tn.control.names_of(tn.instrument.expanded("needle-driver"))
    with (
        Recorder(tmp_path / "other.mcap", axes=other) as recorder,
        refused("joints", "yaw, pitch, jaw", kind=RecordingError),
    ):
        recorder.write(run)


def test_commands_are_by_joint_tendon_and_component(run: tn.Run, wrist: tn.instrument.FullForm) -> None:
    assert run["commanded_handle_angle.handle_pitch"].max() == pytest.approx(np.radians(20))
    assert run["commanded_handle_angle"][-1] == pytest.approx(np.radians([-15, -10, 20]))
    assert np.abs(run["wrench"]).max(axis=0) == pytest.approx([0, 0.5, 0, 0, 0, 2e-3])
    assert run["commanded_spool_velocity"].max(axis=0) == pytest.approx([0, 0, 0, 0, 0.2])
    assert run["grip_force"][-1] > 1
    held = run["commanded_handle_angle.trigger"] == 0
    assert not run["grip_force"][held].max() > 0.1


def test_a_ramp_may_end_in_any_load_and_the_jaws_may_be_pressed_apart(wrist: tn.instrument.FullForm) -> None:
    ramp = Ramp(duration=0.1, wrench=Wrench(fz=-1.0), grip_force=0.2)
    step = StepLoad(joint="handle_yaw", handle_angle=0.1, grip_force=0.1, duration=0.1, release=0.1)
    run = tn.simulate.execute(tn.twin.Twin(wrist), protocol(ramp, Hold(duration=0.05), step))
    assert np.array_equal(run["wrench"][-1], [0, 0, -1, 0, 0, 0])
    assert run["applied_grip_force"][-1] == 0.2
    assert run["applied_grip_force"].min() < 0.1 + 1e-12
    assert run["commanded_handle_angle.handle_yaw"][-1] == pytest.approx(0.1)


@pytest.mark.parametrize("name", ["needle-driver", "maryland-dissector", "two-segment-continuum", "hybrid-real-size"])
def test_any_instrument_runs_the_shipped_protocols(name: str) -> None:
    for shipped in tn.simulate.shipped():
        assert tn.simulate.load(shipped).plan(tn.load(name), 1e-3)


def test_spools_turn_joints_to_the_unloaded_angles_at_which_the_law_aims() -> None:
    ramp = Ramp(duration=0.5, handle_angles={"pitch": 0.6, "jaw_1": -0.3})
    twin = tn.twin.Twin("needle-driver")
    run = tn.simulate.execute(twin, protocol(ramp, Hold(duration=0.3)), tn.control.JointController(twin.inst))
    assert run["commanded_output_angle"][-1] == pytest.approx([0.6, -0.3, 0.0], abs=1e-6)
    assert run["output_angle"][-1] == pytest.approx([0.6, -0.3, 0.0], abs=np.radians(0.3))


def test_a_backbone_in_arcs_meets_tissue_as_its_tip_does() -> None:
    tissue = tn.simulate.TissueContact(stiffness="0.1 N/mm", angle="8 deg")
    flexed = Ramp(duration=1.0, handle_angle="20 deg")
    runs = [
        tn.simulate.execute(
            tn.twin.Twin("two-segment-continuum", quasi_static=True), protocol(*first, flexed, Hold(duration=0.2))
        )
        for first in ([Hold(duration=0.001)], [tissue])
    ]
    free, pressed = (np.degrees(run["output_angle"][-1, :4].sum()) for run in runs)
    assert 8 < pressed < free - 0.5
    force = runs[1]["contact_force"][-1, :4].mean()
    levers = np.abs(tn.statics.load_matrix("two-segment-continuum", 0.0)[:4, 0])
    into = np.radians(pressed - 8) / 4 * levers.sum()
    assert force == pytest.approx(100 * into, rel=0.02)


@pytest.mark.parametrize(
    ("name", "phase", "says"),
    [
        ("needle-driver", Cycles(output_amplitude=3.0, speed=1, count=1), "it must be within the output range of ±80"),
        (
            "two-segment-continuum",
            Cycles(axis="pitch", amplitude=0.1, speed=1, count=1),
            "axis is pitch; it must be yaw",
        ),
        ("hybrid-scaled-up", Cycles(joint="yaw", amplitude=0.1, speed=1, count=1), "joint is yaw; it must be handle_"),
        ("hybrid-scaled-up", Cycles(amplitude=3.0, speed=1, count=1), "amplitude is 171.887 deg.*handle's range"),
        (
            "hybrid-scaled-up",
            StepLoad(joint="trigger", force=1.0, duration=1),
            "force is given, but no force across .* trigger of hybrid-scaled-up moves; give wrench",
        ),
        ("needle-driver", Ramp(handle_angle=1.5, duration=1), "handle_angle is .* pitch's range of ±80 deg"),
        ("hybrid-scaled-up", Ramp(handle_angles={"yaw": 0.1}, duration=1), "names yaw; it must name joints of the han"),
        ("hybrid-scaled-up", Ramp(spool_velocities={"x": 0.1}, duration=1), "names x; it must name tendons"),
        ("two-segment-continuum", Ramp(grip_force=1.0, duration=1), "grip_force is given, but .* no jaws.*give force"),
        ("needle-driver", Ramp(spool_velocity=(1, 1), duration=1), "spool_velocity is given, but .*spool_velocities"),
        ("needle-driver", Cycles(joint="a", amplitude=0.1, speed=1, count=1), "joint is a; it must be pitch or jaw_1"),
        ("two-segment-continuum", GrippedObject(stiffness=1e3), "no jaws that grip; it must be contact"),
    ],
)
def test_what_several_joints_cannot_run_is_refused_in_a_sentence(name: str, phase: object, says: str) -> None:
    with pytest.raises(ProtocolError, match=f"test: phase 1 .*{says}") as problem:
        protocol(phase).plan(tn.instrument.expanded(name), 1e-3)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize(
    ("phase", "key"),
    [
        (StepLoad(wrench=Wrench(my=1.0), duration=1), "wrench.my"),
        (StepLoad(wrench=Wrench(fy=1.0), duration=1), "wrench.fy"),
        (StepLoad(grip_force=1.0, duration=1), "grip_force"),
        (Ramp(handle_angles={"yaw": 0.1}, duration=1), "handle_angles.yaw"),
        (Cycles(joint="yaw", amplitude=0.1, speed=1, count=1), "joint"),
        (GrippedObject(stiffness=1e3), "kind"),
    ],
)
def test_what_a_planar_instrument_cannot_run_is_refused_in_a_sentence(
    phase: object, key: str, scaled: tn.Instrument
) -> None:
    with refused(key, kind=ProtocolError):
        protocol(phase).plan(scaled, 1e-3)


def test_an_object_wider_than_the_jaws_are_open_is_refused(wrist: tn.instrument.FullForm) -> None:
    wide = GrippedObject(stiffness=1e3, opening=5e-3)
    with refused("opening", 0.005, kind=ProtocolError):
        tn.simulate.execute(tn.twin.Twin(wrist), protocol(wide))


def test_a_figure_has_a_curve_for_each_joint_and_tendon(run: tn.Run) -> None:
    figure = run.plot()
    legends = [[text.get_text() for text in panel.get_legend().get_texts()] for panel in figure.axes]
    assert ["yaw", "pitch", "jaw"] in legends
    assert [*run.tendons] in legends
    assert ["grip force"] in legends
    (panel,) = run.plot("tension.grip").axes
    (line,) = panel.lines
    assert np.array_equal(line.get_ydata(), run["tension.grip"])
    with pytest.raises(KeyError):
        run.plot("temperature")


def test_record_info_and_export_take_several_joints(tenodesis: Command, tmp_path: Path) -> None:
    load = StepLoad(wrench=Wrench(fx=0.5), duration=0.05, release=0.05)
    (tmp_path / "load.toml").write_text(protocol(load).to_toml(), "utf-8")
    code, out, _ = tenodesis("record", "needle-driver", "load.toml")
    assert code == 0
    assert out.startswith("recordings/load-needle-driver.mcap: test on needle-driver, 0.1 s, 200 rows")
    assert "jaw_1_wound" in out
    path = "recordings/load-needle-driver.mcap"
    (found,) = json.loads(tenodesis("info", path, "--json")[1])
    assert found["origin"]["joints"] == "pitch, jaw_1, jaw_2"
    assert found["signals"]["wrench.fx"]["greatest"] > 0
    code, out, _ = tenodesis("info", path)
    assert (code, "measured_tension.jaw_2_wound" in out) == (0, True)
    code, out, _ = tenodesis("export", "recording", path, "--out", "table.csv")
    assert (code, out.startswith("table.csv: ")) == (0, True)
    code, out, _ = tenodesis("replay", path, "--plot-out", "replay.png")
    assert code == 0
    assert f"{path}: replayed bit by bit on needle-driver" in out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--law", "robust"), "needle-driver has no joint that a controller can compensate"),
        (("--axis", "yaw"), "needle-driver lists joints and tendons; it must be a planar instrument"),
    ],
)
def test_what_record_does_not_take_is_said(tenodesis: Command, arguments: tuple[str, ...], sentence: str) -> None:
    code, _, problem = tenodesis("record", "needle-driver", *arguments)
    assert (code, problem.count("\n")) == (1, 1)
    assert sentence in problem


@pytest.mark.parametrize("name", ["needle-driver", "two-segment-continuum", "hybrid-scaled-up"])
def test_loose_tendons_are_wound_to_their_pretension_whatever_joints_they_turn(name: str) -> None:
    twin = tn.twin.Twin(name, seed=2)
    twin.loosen(1e-3)
    run = tn.simulate.execute(twin, protocol(tn.simulate.Pretension()))
    wanted = twin.inst.pretensions
    assert (run["measured_tension"][0][wanted > 1] < 0.5 * wanted[wanted > 1]).all()
    np.testing.assert_allclose(run["measured_tension"][-100:].mean(axis=0), wanted, rtol=0, atol=0.5)
    assert np.abs(np.degrees(run["output_angle"][-1])).max() < 0.1


def test_a_tendon_that_does_not_get_tight_is_named() -> None:
    twin = tn.twin.Twin("needle-driver", seed=2)
    twin.loosen(2e-3)
    first = twin.inst.tendons[0].name
    with pytest.raises(ProtocolError, match=f"tendon {first} reads .* after the timeout of 0.1 s"):
        tn.simulate.execute(twin, protocol(tn.simulate.Pretension(timeout=0.1)))
