"""Experiment design: what the planned protocol identifies, what none could, and the command around it."""

import json
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis import simulate
from tenodesis.cli import plan_identification
from tenodesis.errors import CommandError, IdentificationError
from tenodesis.identification import FORMATS
from tenodesis.identification.experiment import OPTIMISTIC, ProposedProtocol, joints, plan, report
from tenodesis.identification.experiment import candidates as blocks
from tenodesis.identification.experiment.information import (
    Criterion,
    CriterionName,
    Information,
    QuantisedSensor,
    choose,
)
from tenodesis.identification.experiment.simulated import InfeasibleProtocolError, SimulatedExperiment
from tenodesis.recording.simulation import record
from tenodesis.twin import Twin

from .conftest import Command, refused

DURATION = 8.0
GAINS = ("mismatch.load_cell_gain.agonist", "mismatch.load_cell_gain.antagonist")


@pytest.fixture(scope="module")
def scaled_up() -> ProposedProtocol:
    return plan(tn.load("scaled-up"), duration=DURATION)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    every = blocks.candidates
    monkeypatch.setattr(blocks, "candidates", lambda inst, forces: every(inst, forces)[::7])


@pytest.mark.slow
def test_predicted_intervals_are_the_scatter_of_estimates_over_seeds(scaled_up: ProposedProtocol) -> None:
    bench = SimulatedExperiment(scaled_up.inst, scaled_up.law, distal_encoder=True)
    commands = scaled_up.protocol.commands(scaled_up.inst, bench.time_step)
    free = [number for number, one in enumerate(scaled_up.parameters) if one.name in scaled_up.open]
    inverse, estimates = None, []
    for seed in range(1, 11):
        run = Twin(scaled_up.inst, seed=seed, time_step=bench.time_step).run(**commands)
        problem, _ = bench.information(run)
        if inverse is None:
            inverse = np.linalg.pinv(problem.jacobian(bench.values, 0)[:, free] * bench.scale[free], rcond=1e-12)
        # at the truth, where one step of Gauss and Newton is the estimate
        estimates.append(-inverse @ problem.residuals(bench.values, 0))
    scatter = np.std(estimates, axis=0, ddof=1) * bench.scale[free]
    # of samples that stand for others as well the noise is larger than what the problem takes them for
    thinned = np.sqrt(problem.sample_time(0) / bench.time_step)
    for name, found in zip(scaled_up.open, scatter.tolist(), strict=True):
        if name in scaled_up.wanted:
            assert 0.5 < found / thinned / scaled_up.proposed.std[name] < 1.7, name


def test_proposed_protocol_identifies_every_wanted_parameter_better_than_cycles_do(scaled_up: ProposedProtocol) -> None:
    assert [one.name for one in scaled_up.baselines] == ["plain cycles", "the paper's cycles"]
    for baseline in scaled_up.baselines:
        assert baseline.seconds >= 0.99 * scaled_up.proposed.seconds
        for name in scaled_up.wanted:
            assert scaled_up.proposed.std[name] < baseline.std[name], (baseline.name, name)


def test_all_that_is_wanted_is_identifiable_and_its_interval_holds_the_file(scaled_up: ProposedProtocol) -> None:
    for one in scaled_up.parameters:
        if one.name in scaled_up.wanted:
            low, high = scaled_up.interval_95[one.name]
            assert scaled_up.identifiable(one.name)
            assert low < one.start < high


@pytest.mark.slow
def test_written_protocol_is_the_one_that_was_predicted_and_can_be_recorded(
    scaled_up: ProposedProtocol, tmp_path: Path
) -> None:
    report.write(scaled_up, tmp_path)
    protocol = simulate.load(tmp_path / report.PROTOCOL)
    assert protocol == scaled_up.protocol
    run = record(tn.load("scaled-up"), protocol, tmp_path / "log.mcap", seed=1)
    assert run.time[-1] == pytest.approx(scaled_up.proposed.seconds)
    assert run.time[-1] <= DURATION
    measured = FORMATS["mcap"].load(tmp_path / "log.mcap")
    problem = FORMATS["mcap"].problem([measured], [], law="capstan", instrument=None)
    assert {one.name for one in problem.parameters} == {one.name for one in scaled_up.parameters}


def test_report_says_that_the_intervals_are_optimistic_and_holds_all_numbers(
    scaled_up: ProposedProtocol, tmp_path: Path
) -> None:
    report.write(scaled_up, tmp_path)
    page = (tmp_path / report.PAGE).read_text("utf-8")
    assert OPTIMISTIC.split(":")[0].replace("'", "&#39;") in page
    assert "<script" not in page
    assert "<img" not in page
    assert "<link" not in page
    numbers = json.loads((tmp_path / report.NUMBERS).read_text("utf-8"))
    assert numbers["parameters"]["stiffness_ratio"]["std"] == scaled_up.proposed.std["stiffness_ratio"]
    assert numbers["warnings"][-1] == OPTIMISTIC


def test_blocks_follow_one_another_within_the_duration(scaled_up: ProposedProtocol) -> None:
    ends = [one.begins + one.seconds for one in scaled_up.blocks]
    assert [one.begins for one in scaled_up.blocks[1:]] == pytest.approx(ends[:-1])
    assert ends[-1] == pytest.approx(scaled_up.proposed.seconds)
    assert len(scaled_up.growth) == len(scaled_up.blocks)
    assert scaled_up.growth[-1]["pretension_ratio"] < scaled_up.growth[0]["pretension_ratio"]


@pytest.mark.parametrize("name", ["scaled-up", "real-size", "examples/pulley.toml", "examples/continuum.toml"])
def test_every_candidate_comes_back_to_where_it_began(name: str) -> None:
    inst = tn.load(name if name in {"scaled-up", "real-size"} else Path(__file__).parents[2] / name)
    inst = inst.axis(inst.axes[0])
    bench = SimulatedExperiment(inst, inst.friction.law, distal_encoder=True)
    run = 0
    for candidate in blocks.candidates(bench.inst, blocks.loads(bench.inst))[::3]:
        try:
            done = bench.run(candidate.phases)
        except InfeasibleProtocolError:
            continue
        run += 1
        assert abs(done["handle_angle"][-1]) < 1e-9, candidate.name
        assert abs(done["force"][-1]) < 1e-9, candidate.name
        assert np.abs(done["spool_angle"][-1]).max() < 1e-6, candidate.name
    assert run > 8


def test_sheath_coefficient_and_bend_act_only_in_their_product(scaled_up: ProposedProtocol) -> None:
    assert scaled_up.held == ("friction.sheath_bend",)
    for name in ("friction.sheath_coefficient", "friction.sheath_bend"):
        assert "product friction.sheath_coefficient · friction.sheath_bend" in scaled_up.unidentifiable[name]
    assert scaled_up.identifiable("friction.sheath_coefficient")


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_sheath_is_not_identifiable_where_its_bend_is_wanted_as_well() -> None:
    found = plan(tn.load("scaled-up"), ["sheath", "friction"], duration=10.0)
    assert found.held == ()
    assert not found.identifiable("friction.sheath_bend")
    assert not found.identifiable("friction.sheath_coefficient")
    assert found.identifiable("friction.vertex_coefficient")


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_gains_are_not_identifiable_without_a_known_force() -> None:
    found = plan(tn.load("scaled-up"), ["load_cells", "stiffness"], duration=8.0, forces=[])
    assert not found.run["force"].any()
    for name in (*GAINS, "stiffness_ratio"):
        assert not found.identifiable(name)
        assert "without a known force" in found.unidentifiable[name]
    assert [one.name for one in found.baselines] == ["plain cycles"]


def test_without_load_all_tensions_scale_together_unseen() -> None:
    inst = tn.load("scaled-up").replace(mismatch=None)
    factor = 1.3
    other = inst.replace(
        tendon_modulus=factor * (inst.tendon_modulus or 0.0),
        pretension=factor * inst.pretension,
        **{
            "dynamics.tip_inertia": factor * (inst.dynamics.tip_inertia or 0.0),
            "dynamics.tip_damping": factor * (inst.dynamics.tip_damping or 0.0),
        },
    )
    handle = 0.4 * np.sin(np.linspace(0, 12, 4000))
    one, two = (Twin(each).run(handle) for each in (inst, other))
    np.testing.assert_allclose(one["output_angle"], two["output_angle"], atol=1e-9)
    np.testing.assert_allclose(factor * one["tension"], two["tension"], rtol=1e-8)


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_share_of_compliance_is_not_identifiable_without_friction() -> None:
    inst = tn.load(Path(__file__).parents[2] / "examples/pulley.toml")
    found = plan(inst, duration=6.0)
    assert "friction" not in " ".join(found.wanted)
    assert "Without friction" in found.unidentifiable["handle_length_share"]
    assert not found.identifiable("handle_length_share")
    assert found.identifiable("stiffness_ratio")


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_without_distal_encoder_stiffness_is_known_less_well() -> None:
    inst = tn.load("scaled-up")
    seen, unseen = (plan(inst, ["stiffness"], duration=6.0, distal_encoder=has) for has in (True, False))
    assert "mismatch.output_encoder_offset" not in unseen.open
    assert unseen.proposed.std["stiffness_ratio"] > seen.proposed.std["stiffness_ratio"]


def _drawn(count: int, width: int) -> list[Information]:
    draw = np.random.default_rng(5)
    rows = draw.standard_normal((count, 3, width)) * 10 ** draw.uniform(0, 2, (count, 1, 1))
    squares = [row.T @ row for row in rows]
    return [Information(square, square) for square in squares]


@pytest.mark.parametrize("name", ["D", "A"])
def test_choice_is_as_good_as_the_best_of_all_choices(name: CriterionName) -> None:
    information, seconds, duration = _drawn(7, 4), [1.0, 2.0, 1.5, 3.0, 1.0, 2.5, 2.0], 5.0
    criterion = Criterion(name, [0, 1, 2, 3], [1, 2])

    def aim(choice: Sequence[int]) -> float:
        return criterion.one(sum((information[one] for one in choice[1:]), information[choice[0]]))

    chosen = choose(information, seconds, duration, criterion, most=1)
    assert sum(seconds[one] for one in chosen) <= duration
    every = [
        choice
        for size in range(1, 6)
        for choice in combinations(range(7), size)
        if sum(seconds[one] for one in choice) <= duration
    ]
    assert aim(chosen) < min(map(aim, every)) + 0.1


def test_criterion_counts_the_others_as_unknown() -> None:
    curvature = np.array([[1e4, 9.9e3], [9.9e3, 1e4]])
    information = Information(curvature, curvature)
    alone, among = (Criterion("D", free, [0]).one(information) for free in ([0], [0, 1]))
    schur = curvature[0, 0] - curvature[0, 1] ** 2 / curvature[1, 1]
    assert alone == pytest.approx(-np.log(curvature[0, 0]) / 2, rel=1e-3)
    assert among == pytest.approx(-np.log(schur) / 2, rel=1e-2)


def test_mean_of_rounded_samples_has_the_deviation_that_is_predicted() -> None:
    draw = np.random.default_rng(0)
    for noise in (0.0, 0.2, 0.4):
        places = draw.random((20000, 1))
        read = np.round(places + noise * draw.standard_normal((20000, 8)))
        found = np.std(read.mean(axis=1) - places[:, 0])
        assert found == pytest.approx(QuantisedSensor(noise, 1.0).deviation_of_mean(8), rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"want": ["colour"]}, r"want names 'colour'.*it must name some of stiffness, .*stiffness_ratio"),
        ({"want": []}, "want is empty"),
        ({"duration": 0.3}, r"duration is 0\.3 s, too short: .*takes 1\.26 s"),
        ({"duration": -1.0}, r"duration is -1.0; it must be above 0 s and up to 600 s"),
        ({"forces": [-1.0]}, r"forces is -1.0; it must be above 0 N"),
        ({"criterion": "E"}, r"criterion is 'E'; it must be D or A"),
        ({"want": ["mismatch.output_encoder_offset"], "distal_encoder": False}, "there is no distal encoder"),
        ({"law": "wet"}, "law is 'wet'; it must be"),
    ],
)
@pytest.mark.usefixtures("few")
def test_request_that_is_not_valid_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        plan(tn.load("scaled-up"), **arguments)


def test_friction_is_not_wanted_of_an_instrument_without_it() -> None:
    with refused("want", "friction", kind=IdentificationError):
        plan(tn.load(Path(__file__).parents[2] / "examples/pulley.toml"), ["friction"])


@pytest.fixture
def app() -> Iterator[typer.Typer]:
    made = typer.Typer(pretty_exceptions_enable=False)
    made.command()(plan_identification.plan_identification)
    made.command()(lambda: None)
    yield made


def run(app: typer.Typer, *arguments: str) -> Any:
    done = CliRunner().invoke(app, ["plan-identification", *arguments])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_command_writes_protocol_page_figure_and_numbers(app: typer.Typer, tmp_path: Path) -> None:
    done = run(app, "scaled-up", "--want", "friction,stiffness", "--duration", "6 s", "--forces", "0.5 N,1 N",
               "--axis", "yaw", "--out", str(tmp_path))  # fmt: skip
    assert done.exit_code == 0
    assert {file.name for file in tmp_path.iterdir()} == {"protocol.toml", "plan.html", "plan.svg", "plan.json"}
    assert "--axis yaw" in done.output
    assert OPTIMISTIC in done.output
    assert json.loads((tmp_path / "plan.json").read_text("utf-8"))["forces"] == [0.5, 1.0]


@pytest.mark.parametrize(
    ("options", "key"),
    [
        (["--duration", "30"], "--duration"),
        (["--forces", "1 N,2 mm"], "--forces"),
    ],
)
def test_command_refuses_what_it_does_not_understand(app: typer.Typer, options: list[str], key: str) -> None:
    with refused(key, kind=CommandError):
        run(app, "scaled-up", *options)


def test_command_never_overwrites_the_instrument(app: typer.Typer, tmp_path: Path) -> None:
    given = tmp_path / "protocol.toml"
    given.write_text(tn.instrument.text.to_toml(tn.load("scaled-up")), "utf-8")
    with refused("--out", kind=CommandError):
        run(app, str(given), "--out", str(tmp_path))


@pytest.mark.slow
def test_motions_of_several_joints_are_planned(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, tenodesis: Command
) -> None:
    monkeypatch.setattr(joints, "BLOCK", 0.15)
    code, out, _ = tenodesis(
        "plan-identification", "needle-driver", "--duration", "0.45 s", "--want", "stiffness,radius"
    )
    assert code == 0
    assert "both jaws" in out or "all joints" in out
    found = json.loads(Path("out/plan-identification/plan.json").read_text())
    assert len(found["blocks"]) == 3
    assert found["parameters"]["pitch.radius"]["identifiable"]
    heading = Path("out/plan-identification/commands.csv").read_text().partition("\n")[0]
    assert heading.startswith("time [s],commanded_spool_velocity.pitch_wound [rad/s]")


def test_friction_that_a_file_lacks_is_assumed_and_said_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, tenodesis: Command
) -> None:
    monkeypatch.setattr(joints, "BLOCK", 0.1)
    monkeypatch.setattr(joints, "_motions", lambda inst, force: every(inst, 0.0)[-1:])
    inst = tn.instrument.expanded(tn.load("needle-driver")).replace(friction={})
    (tmp_path / "mine.toml").write_text(tn.instrument.text.to_toml(inst))
    code, out, _ = tenodesis("plan-identification", "mine.toml", "--duration", "0.1 s", "--want", "friction,stiffness")
    assert code == 0
    (line,) = (one for one in out.splitlines() if "vertex_coefficient" in one)
    assert "none, 0.1 assumed" in line
    assert out.count("assumed") == 1


def test_motions_that_no_duration_holds_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joints, "BLOCK", 0.1)
    monkeypatch.setattr(joints, "_motions", lambda inst, force: every(inst, force)[:1] + every(inst, force)[-1:])
    with refused("duration", kind=IdentificationError):
        plan(tn.load("needle-driver"), duration=0.05, forces=[])


every = joints._motions
