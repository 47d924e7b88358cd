import csv
import json
import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from numpy.typing import NDArray
from scipy import integrate
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis import threads, tolerance, twin
from tenodesis.cli import tolerance as tolerance_command
from tenodesis.errors import StudyError
from tenodesis.instrument import Instrument
from tenodesis.tolerance import conduct, evaluation, report, sampling
from tenodesis.tolerance.evaluation import cycles
from tenodesis.tolerance.parameters import resolve

from .conftest import EXAMPLES, refused

SMALL = 16


def varied(*rows: str) -> tolerance.Tolerances:
    """Tolerances from rows like `key distribution width [instrument]`."""
    text = ""
    for row in rows:
        key, distribution, width, *of = row.split("|")
        name = "standard_deviation" if distribution == "normal" else "half_width"
        text += f'[[parameters]]\nkey = "{key}"\ndistribution = "{distribution}"\n{name} = {width}\n'
        text += f'instrument = "{of[0]}"\n' if of else ""
    return tolerance.parse(text)


FEW = (
    'distal_gear_radius|uniform|"0.1 mm"',
    'tendon_modulus|normal|"5 %"',
    "friction.vertex_coefficient|triangular|0.03",
)


@pytest.fixture(scope="module")
def small(real: Instrument, scaled: Instrument) -> tolerance.Study:
    return tolerance.study(real, scaled, varied(*FEW), samples=64, seed=0)


def log_variance(half_width: float) -> float:
    """Variance of log(1 + u) for u uniform between plus and minus a half width."""

    def mean(power: int) -> float:
        return integrate.quad(lambda u: math.log1p(u) ** power, -half_width, half_width)[0] / (2 * half_width)

    return mean(2) - mean(1) ** 2


def test_indices_of_a_product_are_the_shares_of_its_factors_log_variances(scaled: Instrument) -> None:
    # Theta is proportional to L / (E d^2), so that its log is a sum of independent terms (eq. 17 and Table I).
    widths = {"overall_length": 0.1, "tendon_modulus": 0.15, "tendon_diameter": 0.04}
    rows = [f'{key}|uniform|"{100 * width} %"' for key, width in widths.items()]
    parameters = resolve(varied(*rows), scaled, scaled)
    matrix = sampling.scheme(parameters, 512, 3)
    keys = [one.key for one in parameters]
    values = np.array(
        [
            math.log(
                tn.statics.loss_of_dexterity(scaled.replace(**dict(zip(keys, row.tolist(), strict=True))), 0.7, 1.0)
            )
            for row in matrix
        ]
    )
    found = sampling.estimate(parameters, values, 3)
    power = {"overall_length": 1, "tendon_modulus": 1, "tendon_diameter": 2}
    variances = np.array([power[key] ** 2 * log_variance(width) for key, width in widths.items()])
    shares = variances / variances.sum()
    np.testing.assert_allclose(found.total, shares, atol=0.02)
    assert np.all(np.abs(found.first - shares) <= found.first_half_width + 0.01)
    assert values.var() == pytest.approx(variances.sum(), rel=0.02)


def test_a_row_of_the_study_is_a_run_of_the_twin(small: tolerance.Study) -> None:
    _, way = cycles(tn.similarity.compare(small.real_size, small.scaled_up))
    row = 7
    changes = {one.key: float(small.matrix[row, n]) for n, one in enumerate(small.parameters)}
    inst = small.scaled_up.replace(**changes)
    force = small.force * small.force_factor * way.load
    run = twin.Twin(inst, time_step=way.time_step, quasi_static=True).run(way.handle, force)
    loss = tn.statics.output_angle(inst, way.end) - run["output_angle"][-1]
    assert small.responses["loss_flexion"].scheme[row] == pytest.approx(np.degrees(loss), abs=1e-9)


class Backwards:
    """An engine of one's own: the last chunk first."""

    def stream(
        self, function: Callable[[Any, Any], Any], shared: Any, chunks: Sequence[Any], sizes: Sequence[int]
    ) -> Iterator[tuple[int, Any]]:
        return ((n, function(shared, chunks[n])) for n in reversed(range(len(chunks))))


@pytest.mark.parametrize("chunk", [1, 37, 10_000])
def test_neither_threads_nor_chunks_nor_their_order_change_a_bit(
    small: tolerance.Study, monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    monkeypatch.setattr(threads, "_threads", 1 if chunk > 1 else 2)
    monkeypatch.setattr(conduct, "CHUNK", chunk)
    again = tolerance.study(small.real_size, small.scaled_up, small.tolerances, samples=64, engine=Backwards())
    assert_same(again, small)


def assert_same(one: tolerance.Study, other: tolerance.Study) -> None:
    np.testing.assert_array_equal(one.matrix, other.matrix)
    np.testing.assert_array_equal(one.status, other.status)
    for key, response in one.responses.items():
        np.testing.assert_array_equal(response.scheme, other.responses[key].scheme)
        np.testing.assert_array_equal(response.at_quantiles, other.responses[key].at_quantiles)
        mine, theirs = response.indices, other.responses[key].indices
        assert mine is not None and theirs is not None
        np.testing.assert_array_equal(mine.total, theirs.total)
        np.testing.assert_array_equal(mine.total_half_width, theirs.total_half_width)


def test_another_seed_gives_another_study(small: tolerance.Study) -> None:
    other = tolerance.study(small.real_size, small.scaled_up, small.tolerances, samples=64, seed=1)
    assert not np.array_equal(other.matrix, small.matrix)


def test_progress_comes_to_all_runs(real: Instrument, scaled: Instrument) -> None:
    reported: list[tuple[int, int]] = []
    found = tolerance.study(
        real, scaled, varied(FEW[0]), samples=SMALL, progress=lambda done, total: reported.append((done, total))
    )
    assert reported[0] == (0, found.runs)
    assert reported[-1] == (found.runs, found.runs)


def test_samples_have_the_distributions_asked_for(scaled: Instrument) -> None:
    parameters = resolve(varied(*FEW), scaled, scaled)
    matrix = sampling.scheme(parameters, 1024, 0)
    nominal = np.array([one.nominal for one in parameters])
    widths = np.array([one.width for one in parameters])
    np.testing.assert_allclose(matrix.mean(0), nominal, rtol=2e-3)
    np.testing.assert_allclose(matrix.std(0), widths * [3**-0.5, 1, 6**-0.5], rtol=0.02)
    assert np.all(np.abs(matrix - nominal)[:, [0, 2]] <= widths[[0, 2]] * (1 + 1e-12))
    low, high = sampling.levels(parameters, (0.05, 0.95))
    np.testing.assert_allclose((high - low) / 2, widths * [0.9, 1.644854, 1 - 0.1**0.5], rtol=1e-6)


def test_without_friction_the_loss_is_that_of_statics_from_either_side(real: Instrument, scaled: Instrument) -> None:
    bare = scaled.replace(friction=None, mismatch=None)
    found = tolerance.study(real.replace(friction=None), bare, varied('tendon_modulus|uniform|"5 %"'), samples=SMALL)
    held = tn.statics.output_angle(bare, [0.0, found.end], [0.0, found.force * found.force_factor])[1]
    expected = np.degrees(tn.statics.output_angle(bare, found.end) - held)
    for key in ("loss_flexion", "loss_extension"):
        assert found.responses[key].nominal == pytest.approx(expected, abs=1e-6)
    assert found.responses["loop_width"].nominal == pytest.approx(0, abs=1e-6)


def test_an_instrument_is_similar_to_itself(any_inst: Instrument) -> None:
    found = tolerance.study(any_inst, any_inst, samples=SMALL, force=0.4)
    assert found.responses["similarity_largest"].nominal == pytest.approx(0, abs=1e-9)
    assert found.responses["similarity_largest"].quantile(0.5) > 0
    assert not found.failed


def test_a_stiffer_tendon_loses_less_and_more_friction_widens_the_loop(small: tolerance.Study) -> None:
    _, modulus, friction = range(3)
    loss, loop = small.responses["loss_flexion"], small.responses["loop_width"]
    assert loss.at_quantiles[modulus, 1] < loss.nominal < loss.at_quantiles[modulus, 0]
    assert loop.at_quantiles[friction, 0] < loop.nominal < loop.at_quantiles[friction, 1]
    assert loop.order[0] == friction


def test_weights_are_nominal_whatever_the_sample(real: Instrument, scaled: Instrument) -> None:
    found = tolerance.study(real, scaled, varied('tendon_modulus|uniform|"10 %"'), samples=SMALL)
    assert found.force_factor == tn.similarity.compare(real.axis("yaw"), scaled).force_factor()
    assert found.force * found.force_factor == pytest.approx(max(scaled.conditions.forces))


def test_a_real_size_tolerance_adds_the_real_size_instruments_own_loss(real: Instrument, scaled: Instrument) -> None:
    rows = ('pretension|uniform|"1 N"', 'tendon_modulus|uniform|"5 %"|real-size')
    found = tolerance.study(real, scaled, varied(*rows), samples=SMALL)
    own = found.responses["real_size_loss_flexion"]
    assert own.at_quantiles[1, 1] < own.nominal < own.at_quantiles[1, 0]
    assert own.at_quantiles[0, 0] == own.at_quantiles[0, 1] == own.nominal
    assert found.responses["loss_flexion"].at_quantiles[1].tolist() == [found.responses["loss_flexion"].nominal] * 2


def test_lost_tips_are_counted_and_left_out_and_then_there_are_no_indices(real: Instrument, scaled: Instrument) -> None:
    found = tolerance.study(real, scaled, varied('tendon_modulus|uniform|"50 %"'), samples=64, force=2.0)
    assert 0.05 < found.failed < 0.95
    lost = found.status != 0
    for one in found.responses.values():
        assert np.isnan(one.scheme[lost]).all() and np.isfinite(one.scheme[~lost]).all()
        assert one.samples.size == round((1 - found.failed) * 128)
        assert one.indices is None and math.isfinite(one.quantile(0.95))
    assert any("failed" in message for message in found.statements)
    assert any("Sobol indices are valid; there are none" in message for message in found.statements)


def test_few_lost_tips_cost_the_indices_only_their_base_samples(
    small: tolerance.Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluate = evaluation.evaluate

    def loses(task: evaluation.Evaluation, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        found = evaluate(task, rows)
        if len(rows) == conduct.CHUNK:
            found[6] = [*[np.nan] * 5, evaluation.INVALID]
        return found

    monkeypatch.setattr(evaluation, "evaluate", loses)
    found = tolerance.study(small.real_size, small.scaled_up, small.tolerances, samples=64)
    assert found.incomplete == pytest.approx(1 / 64)
    assert found.failed == 0
    whole, less = small.responses["loss_flexion"].indices, found.responses["loss_flexion"].indices
    assert whole is not None and less is not None
    np.testing.assert_allclose(less.total, whole.total, atol=0.1)
    assert any("left out of the indices" in message for message in found.statements)


def test_a_sample_that_is_no_instrument_counts_as_failed(real: Instrument, scaled: Instrument) -> None:
    # At 45 deg of handle the distal gear cannot be less than 0.383 times the proximal one's radius.
    narrow = scaled.replace(distal_gear_radius=6.6e-3)
    found = tolerance.study(real, narrow, varied('distal_gear_radius|uniform|"0.4 mm"'), samples=SMALL, force=0.1)
    assert evaluation.INVALID in found.status
    assert found.failed > 0


def test_a_key_that_nothing_depends_on_has_no_indices(real: Instrument, scaled: Instrument) -> None:
    found = tolerance.study(real, scaled, varied('sensors.encoder_noise|uniform|"50 %"'), samples=SMALL)
    assert all(one.indices is None for one in found.responses.values())


def test_rounding_is_no_finding(real: Instrument, scaled: Instrument, tmp_path: Path) -> None:
    found = tolerance.study(
        real, scaled.replace(friction=None, mismatch=None), varied('pretension|uniform|"1 %"'), samples=SMALL, force=0.1
    )
    loss = found.responses["loss_flexion"]
    assert 0 <= np.ptp(loss.scheme) < 1e-6
    assert not loss.varies and loss.indices is None and loss.order == ()
    assert "The loss in flexion does not vary: all its samples are within 1e-06 deg." in found.statements
    assert not any("indices" in message for message in found.statements)
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures/sobol.svg").write_text("of an earlier study")
    report.write(found, tmp_path)
    assert not (tmp_path / "figures/sobol.svg").exists()
    page = (tmp_path / "tolerance.html").read_text("utf-8")
    assert "nothing: it does not vary" in page and "Sobol indices with half widths" not in page
    numbers = json.loads((tmp_path / "tolerance.json").read_text("utf-8"))["responses"]["loss_flexion"]
    assert numbers["varies"] is False and numbers["sobol"] is None
    rows = tolerance_command._dominating(found)
    assert list(rows.columns[1].cells) == ["does not vary"] * len(found.responses)


def test_too_few_samples_are_said_to_be_too_few(real: Instrument, scaled: Instrument) -> None:
    few = tolerance.study(real, scaled, samples=8, force=0.4)
    widest = max(one.indices.total_half_width.max() for one in few.responses.values() if one.indices)
    assert widest > 0.5
    assert any("The 8 base samples are too few for Sobol indices" in message for message in few.statements)


def test_two_mechanisms_are_compared_where_their_unloaded_outputs_are_equal(
    real: Instrument, pulley: Instrument
) -> None:
    comparison = tn.similarity.compare(real, pulley)
    ours, theirs = cycles(comparison)
    np.testing.assert_allclose(
        tn.statics.output_angle(pulley, theirs.handle), tn.statics.output_angle(real, ours.handle), atol=1e-9
    )
    assert np.abs(theirs.handle).max() <= pulley.handle_range * (1 + 1e-9)
    assert np.abs(theirs.handle - ours.handle).max() > 0.08
    # Without friction and all but unloaded, nothing is left of the difference between the mechanisms.
    calm = [inst.replace(friction=None, mismatch=None) for inst in (real, pulley)]
    found = tolerance.study(*calm, varied('tendon_modulus|uniform|"5 %"'), samples=8, force=1e-6)
    assert found.responses["similarity_largest"].nominal < 1e-3


def test_a_scale_model_that_reaches_too_little_is_refused(real: Instrument, scaled: Instrument) -> None:
    short = scaled.replace(handle_range=0.2)
    with refused("scaled_up", "scaled-up", kind=StudyError):
        tolerance.study(real, short, samples=8)


def test_samples_round_up_to_a_power_of_two(real: Instrument, scaled: Instrument) -> None:
    assert tolerance.study(real, scaled, varied(FEW[0]), samples=9).samples == SMALL


def test_defaults_suit_every_mechanism(any_inst: Instrument) -> None:
    keys = [one.key for one in tolerance.default(any_inst).parameters]
    assert {"pretension", "overall_length", "tendon_modulus"} <= set(keys)
    assert ("friction.vertex_coefficient" in keys) == (any_inst.friction.law != "none")
    assert all(one.source for one in tolerance.default(any_inst).parameters)
    resolve(tolerance.default(any_inst), any_inst, any_inst)
    assert "tendon_stiffness" in [one.key for one in tolerance.default(given(any_inst)).parameters]


def given(inst: Instrument) -> Instrument:
    return inst.replace(tendon_stiffness=2e4, tendon_modulus=None)


def test_default_tolerances_of_dimensions_are_those_of_iso_2768(scaled: Instrument) -> None:
    found = {one.key: one.half_width for one in tolerance.default(scaled).parameters}
    assert found["distal_gear_radius"] == "0.1 mm"  # f, above 6 to 30 mm
    assert found["end_effector_length"] == "0.3 mm"  # m, above 30 to 120 mm
    assert found["handle_length"] == "0.5 mm"  # m, above 120 to 400 mm
    assert found["overall_length"] == "0.8 mm"  # m, above 400 to 1000 mm


def test_the_example_is_a_tolerance_file_of_the_paper_s_pair(real: Instrument, scaled: Instrument) -> None:
    parameters = resolve(tolerance.load(EXAMPLES / "tolerances.toml"), real.axis("yaw"), scaled)
    widths = {(one.instrument, one.key): one.width for one in parameters}
    assert widths["scaled-up", "tendon_modulus"] == pytest.approx(0.03 * 50e9)
    assert widths["scaled-up", "friction.sheath_bend"] == pytest.approx(np.radians(5))
    assert widths["real-size", "friction.vertex_coefficient"] == 0.02


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ('no_such_key|uniform|"1 mm"', "no_such_key is not a known key of scaled-up; keys .* are .*overall_length"),
        ('joint_type|uniform|"1 mm"', "joint_type of scaled-up is 'tendon-gear', not a number"),
        ("friction.sheath_contacts|uniform|1", "is 1, an integer; only a number can vary"),
        ('tendon_length|uniform|"1 mm"', "tendon_length of scaled-up is not given"),
        ('handle_range|uniform|"1 deg"', "handle_range of scaled-up cannot vary"),
        ('pretension|uniform|"-1 N"', r"pretension of scaled-up: half_width = '-1 N': it must be a force above 0 N"),
        ('pretension|uniform|"-5 %"', r"half_width = '-5 %': it must be above 0"),
        ('friction.vertex_coefficient|uniform|"2 mm"', "it is not understood; it must be a number"),
        ('friction.viscous|uniform|"5 %"', "the file's value is 0, of which there is no share"),
        (
            "friction.vertex_coefficient|normal|0.05",
            r"a normal distribution about 0.1 with a standard_deviation of 0.05 exceeds the bounds of an instrument "
            r"file \(from 0 to 3\) with a probability of 2.3 %",
        ),
        ('distal_gear_radius|uniform|"10 mm"', "exceeds the bounds .* with a probability of 13 %"),
    ],
)
def test_a_tolerance_that_cannot_be_is_refused_in_one_sentence(
    real: Instrument, scaled: Instrument, row: str, message: str
) -> None:
    with pytest.raises(StudyError, match=message) as caught:
        tolerance.study(real, scaled, varied(row), samples=SMALL)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "tolerances: parameters is .*; it must be one table"),
        ("parameters = []", "tolerances: parameters is .*; it must be one table"),
        ('[[parameters]]\nkey = "pretension"\nhalf_width = "1 N"', "parameter 1: distribution is missing"),
        (
            '[[parameters]]\nkey = "pretension"\ndistribution = "cauchy"\nhalf_width = "1 N"',
            "parameter 1: distribution = 'cauchy': it must be 'uniform', 'triangular' or 'normal'",
        ),
        (
            '[[parameters]]\nkey = "pretension"\ndistribution = "normal"\nhalf_width = "1 N"',
            "half_width of pretension is given, which a normal distribution does not have; it has standard_",
        ),
        (
            '[[parameters]]\nkey = "pretension"\ndistribution = "normal"',
            "standard_deviation of pretension is missing; a normal distribution needs it",
        ),
        (
            '[[parameters]]\nkey = "pretension"\ndistribution = "uniform"\nhalf_width = "1 N"\nwidth = 1',
            "parameter 1: width is not a known key .did you mean half_width.*; it must be one of key, distribution",
        ),
        (
            2 * '[[parameters]]\nkey = "pretension"\ndistribution = "uniform"\nhalf_width = "1 N"\n',
            "pretension of scaled-up is given twice",
        ),
    ],
)
def test_a_tolerance_file_that_is_none_is_refused(text: str, message: str) -> None:
    with pytest.raises(StudyError, match=message):
        tolerance.parse(text)


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"samples": 1}, "samples"),
        ({"samples": 0.5}, "samples"),
        ({"seed": -1}, "seed"),
        ({"force": 0.0}, "force"),
        ({"force": 3.0}, "force"),
        ({"engine": "slurm"}, "engine"),
        ({"address": "127.0.0.1:6379"}, "address"),
        ({"engine": "ray"}, "address"),
    ],
)
def test_a_study_that_cannot_be_is_refused(
    real: Instrument, scaled: Instrument, arguments: dict[str, object], key: str
) -> None:
    with refused(key, arguments.get(key, ...), kind=StudyError):
        tolerance.study(real, scaled, **arguments)  # type: ignore[arg-type]


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with refused("file", kind=StudyError, allowed="the path of a TOML file"):
        tolerance.load(tmp_path / "none.toml")


def test_the_folder_has_a_page_that_needs_nothing_beside_it(small: tolerance.Study, tmp_path: Path) -> None:
    report.write(small, tmp_path / "new")
    page = (tmp_path / "new/tolerance.html").read_text("utf-8")
    assert not re.search(r'(src|href)="(?!#)', page)
    assert page.count("<svg") == 3
    for name in ("distributions", "tornado", "sobol"):
        assert {path.suffix for path in (tmp_path / "new/figures").glob(f"{name}.*")} == {".svg", ".png"}
    numbers = json.loads((tmp_path / "new/tolerance.json").read_text("utf-8"))
    loss, found = numbers["responses"]["loss_flexion"], small.responses["loss_flexion"]
    assert loss["quantiles"]["0.95"] == found.quantile(0.95)
    assert found.indices is not None
    assert loss["sobol"]["total"]["scaled-up.tendon_modulus"] == found.indices.total[1]
    with (tmp_path / "new/samples.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 64 * (3 + 2)
    assert float(rows[3]["loss_flexion [deg]"]) == pytest.approx(found.scheme[3], rel=1e-8)


def test_the_folder_is_written_completely_or_not_at_all(
    small: tolerance.Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(report.figures, "plots", lambda _: [])
    monkeypatch.setattr(report, "_rendered", full)
    with refused("path", kind=StudyError):
        report.write(small, tmp_path)
    assert not list(tmp_path.iterdir())


def test_the_command_prints_quantiles_and_what_dominates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[Path] = []
    monkeypatch.setattr(tolerance_command, "write", lambda _, out: written.append(out))
    app = typer.Typer()
    app.command("tolerance")(tolerance_command.study_tolerances)
    app.command()(lambda: None)
    arguments = ["tolerance", "real-size", "scaled-up", "--samples", "16", "--force", "0.4 N", "--out", str(tmp_path)]
    message = CliRunner().invoke(app, arguments)
    assert message.exit_code == 0, message.output
    assert "loss in flexion" in message.output
    assert "what dominates" in message.output
    assert written == [tmp_path]
    refused = CliRunner().invoke(app, [*arguments[:3], "--force", "0.4 mm"])
    assert "--force = '0.4 mm': it is measured in mm" in str(refused.exception)
