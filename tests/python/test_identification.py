"""The fitting engine on problems whose answer is known in closed form."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from tenodesis.errors import IdentificationError
from tenodesis.identification import Fit, Parameter, Problem, fit, jacobian_error, to_json
from tenodesis.identification.search import Search
from tenodesis.identification.uncertainty import (
    Linearised,
    autocorrelation,
    block_length,
    correlation_samples,
    estimate,
    long_run,
    resampled,
    whiteness,
)
from tenodesis.run import Array

from .conftest import refused

STEP = 0.01


class Model(Problem):
    """Some function of the parameters over time, measured with noise; one run for each set of measurements."""

    def __init__(
        self,
        parameters: Sequence[Parameter],
        function: Callable[[Array], Array],
        measured: Sequence[Array],
        *,
        noise: float = 1.0,
        derivative: Callable[[Array], Array] | None = None,
    ) -> None:
        self.parameters = tuple(parameters)
        self.runs = tuple(f"run {n}" for n in range(len(measured)))
        self.function, self.derivative, self.measured, self.noise = function, derivative, list(measured), noise
        self.calls = 0

    def residuals(self, values: Array, run: int) -> Array:
        self.calls += 1
        return (self.measured[run] - self.function(values)) / self.noise

    def jacobian(self, values: Array, run: int) -> Array | None:
        return None if self.derivative is None else -self.derivative(values) / self.noise

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        return {"tension_N": self.measured[run] - self.function(values)}

    def sample_time(self, run: int) -> float:
        return STEP


def parameter(name: str, start: float, lower: float, upper: float, unit: str = "N") -> Parameter:
    return Parameter(name, unit, start, lower, upper, f"meaning of {name}")


LINE = (parameter("gain", 1, -10, 10), parameter("offset", 0, -10, 10))
TRUTH = np.array([2.0, 1.0])


def design(count: int) -> Array:
    return np.column_stack([np.sin(0.3 * 2 * np.pi * STEP * np.arange(count)), np.ones(count)])


def coloured(count: int, root: float, seed: int, size: float = 1.0) -> Array:
    """First-order autoregressive noise of this standard deviation."""
    white = np.random.default_rng(seed).normal(size=count + 500)
    return np.asarray(lfilter([np.sqrt(1 - root**2)], [1, -root], white)[500:] * size)


def line(errors: Sequence[Array], noise: float = 1.0, step: float = 0.0, *, exact: bool = True) -> Model:
    matrix = design(errors[0].size)
    measured = [matrix @ TRUTH + one for one in errors]
    if step:
        measured = [step * np.round(one / step) for one in measured]
    return Model(LINE, lambda v: matrix @ v, measured, noise=noise, derivative=(lambda _: matrix) if exact else None)


def covered(intervals: dict[str, tuple[float, float]] | None) -> list[bool]:
    assert intervals is not None
    return [low <= true <= high for (low, high), true in zip(intervals.values(), TRUTH, strict=True)]


def naive(found: Fit) -> list[bool]:
    pairs = zip(found.values.values(), found.std_white.values(), TRUTH, strict=True)
    return [abs(value - true) < 1.96 * std for value, std, true in pairs]


def within_binomial(hits: Array, share: float = 0.95) -> bool:
    """Whether so many hits are what chance leaves of that share, one time in a thousand not."""
    low, high = stats.binom.interval(0.999, hits.size, share)
    return bool(low <= hits.sum() <= high)


# what is found


def test_a_straight_line_is_what_linear_regression_says() -> None:
    problem = line([coloured(500, 0, 1)], noise=0.7)
    found = fit(problem, train=[0], starts=1)
    matrix = design(500)
    expected, squares, *_ = np.linalg.lstsq(matrix, problem.measured[0])
    covariance = squares[0] / (500 - 2) * np.linalg.inv(matrix.T @ matrix)
    assert list(found.values.values()) == pytest.approx(expected, abs=1e-8)
    assert list(found.std_white.values()) == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-6)
    assert found.train_rmse["tension_N"] == pytest.approx(np.sqrt(squares[0] / 500))
    assert found.cost == pytest.approx(0.5 * squares[0] / 0.49)


@pytest.mark.slow
@pytest.mark.parametrize(("root", "step", "size"), [(0.0, 0.0, 1.0), (0.9, 0.0, 1.0), (0.9, 1.0, 1.0), (0.0, 0.5, 0.2)])
def test_95_percent_intervals_cover_the_truth_whatever_the_noise(root: float, step: float, size: float) -> None:
    tries = [fit(line([coloured(1000, root, n, size)], step=step), train=[0], starts=1) for n in range(200)]
    # two parameters of a fit are nearly independent here
    hits = np.array([covered(one.interval_95) for one in tries])
    assert hits.mean() > 0.9
    assert within_binomial(hits.ravel(), 0.94 if root else 0.95)
    if root:
        assert np.mean([naive(one) for one in tries]) < 0.5


@pytest.mark.slow
def test_block_bootstrap_agrees_with_the_corrected_interval() -> None:
    for root, allowed in ((0.0, 0.05), (0.8, 0.15)):
        ratios, hits = [], []
        for seed in range(12):
            found = fit(line([coloured(2000, root, seed)]), train=[0], starts=1, bootstrap=100, seed=seed)
            assert found.bootstrap_interval_95 is not None
            for corrected, drawn in zip(found.interval_95.values(), found.bootstrap_interval_95.values(), strict=True):
                ratios.append((drawn[1] - drawn[0]) / (corrected[1] - corrected[0]))
            hits += covered(found.bootstrap_interval_95)
        assert np.mean(ratios) == pytest.approx(1, abs=allowed)
        assert np.mean(hits) > 0.75


def play(values: Array, wish: Array) -> tuple[Array, Array]:
    """Stick and slip with half width values[1] after gain values[0]; and its exact derivatives."""
    gain, width = values
    state, slope, out, slopes = 0.0, np.zeros(2), np.empty(wish.size), np.empty((wish.size, 2))
    for n, at in enumerate(wish):
        if state < gain * at - width:
            state, slope = gain * at - width, np.array([at, -1.0])
        elif state > gain * at + width:
            state, slope = gain * at + width, np.array([at, 1.0])
        out[n], slopes[n] = state, slope
    return out, slopes


def play_model(derivative: bool = True, seed: int = 3) -> Model:
    time = STEP * np.arange(1500)
    wish = 3 * np.sin(2 * time) + 1.2 * np.sin(7.3 * time)
    measured = play(np.array([1.7, 0.8]), wish)[0] + np.random.default_rng(seed).normal(size=wish.size) * 0.05
    return Model(
        (parameter("gain", 1, 0.1, 5, "1"), parameter("width", 0.1, 0, 3)),
        lambda v: play(v, wish)[0],
        [measured],
        noise=0.05,
        derivative=(lambda v: play(v, wish)[1]) if derivative else None,
    )


def test_a_play_operator_is_recovered_through_stick_and_slip() -> None:
    found = fit(play_model(), train=[0], starts=8)
    for name, true in (("gain", 1.7), ("width", 0.8)):
        low, high = found.interval_95[name]
        assert low <= true <= high
        assert high - low < 0.02
    assert found.same_optimum >= 5
    assert all(one.white for one in found.whiteness)


def test_exact_derivatives_are_those_of_differences_and_save_evaluations() -> None:
    assert jacobian_error(play_model(), np.array([1.5, 0.6]), 0) < 1e-6
    exact = fit(play_model(), train=[0], starts=1)
    differenced = fit(play_model(derivative=False), train=[0], starts=1)
    forbidden = fit(play_model(), train=[0], starts=1, derivatives="differences")
    assert exact.jacobians > 0
    assert differenced.jacobians == forbidden.jacobians == 0
    assert differenced.evaluations > 2 * exact.evaluations
    assert list(exact.values.values()) == pytest.approx(list(differenced.values.values()), rel=1e-5)
    assert forbidden.values == differenced.values


def two_valleys() -> Model:
    """Frequency of a sine: many valleys, of which the start's is the wrong one."""
    time = STEP * np.arange(600)
    measured = np.sin(4.0 * time) + 0.1 * np.random.default_rng(5).normal(size=600)
    return Model((parameter("frequency", 1.0, 0.5, 8, "rad/s"),), lambda v: np.sin(v[0] * time), [measured], noise=0.1)


def test_many_starts_find_the_valley_that_one_start_misses() -> None:
    alone, many = fit(two_valleys(), train=[0], starts=1), fit(two_valleys(), train=[0], starts=16)
    assert abs(alone.values["frequency"] - 4) > 1
    assert many.values["frequency"] == pytest.approx(4, abs=0.01)
    assert many.cost < alone.cost / 10
    assert 1 <= many.same_optimum < 16
    assert len(many.costs) == 16


def test_steps_near_an_optimum_lead_past_small_optima_and_do_not_fall_over_cliffs() -> None:
    matrix = design(400)

    def rough(values: Array) -> Array:
        # ripples that fold the way to the optimum, and a jump next to it
        jump = 5.0 if values[0] > TRUTH[0] + 0.02 else 0.0
        return np.asarray(matrix @ (values + 0.01 * np.sin(300 * (values - TRUTH))) + jump * (matrix[:, 0] > 0.5))

    search = Search(Model(LINE, rough, [matrix @ TRUTH], noise=0.1), [0, 1], [0], "linear", "exact")
    start = np.array([1.3, 0.6])
    slid = search.solve(start)
    assert slid is not None and slid.cost > 50
    search.changes = np.diag([0.4, 0.4])
    assert search.stepped(start) == pytest.approx(TRUTH, abs=0.02)
    assert search.cost(search.stepped(start)) < 1


@pytest.mark.slow
def test_the_same_seed_gives_the_same_result_and_another_one_other_starts() -> None:
    one, same, other = (fit(play_model(), train=[0], bootstrap=40, seed=seed) for seed in (1, 1, 2))
    assert one.values == same.values
    assert one.interval_95 == same.interval_95
    assert one.bootstrap_interval_95 == same.bootstrap_interval_95
    assert one.bootstrap_interval_95 != other.bootstrap_interval_95
    plain = [to_json(found, format="f", law="l") | {"seconds": 0} for found in (one, same)]
    assert plain[0] == plain[1]


def test_held_out_runs_change_nothing_of_the_fit() -> None:
    errors = [coloured(400, 0.5, n) for n in range(3)]
    first, second = line(errors), line([*errors[:2], 50 * errors[2]])
    one, other = (fit(problem, train=[0, 1], test=[2], bootstrap=40) for problem in (first, second))
    without = fit(first, train=[0, 1], bootstrap=40)
    held = {"files", "test_rmse", "seconds"}
    for name in (field.name for field in dataclasses.fields(one) if field.name not in held):
        for against in (other, without):
            mine, theirs = getattr(one, name), getattr(against, name)
            if name == "correlation":
                assert mine.tobytes() == theirs.tobytes()
            elif name not in {"identifiability", "whiteness"}:
                assert mine == theirs, name
    assert one.test_rmse["tension_N"] < other.test_rmse["tension_N"] / 10
    assert without.test_rmse == {}
    assert [file.split for file in one.files] == ["train", "train", "test"]


def test_soft_l1_stands_outliers_that_pull_least_squares_away() -> None:
    errors = coloured(800, 0, 4, 0.1)
    errors[::16] += 8.0
    pulled = fit(line([errors], noise=0.1), train=[0])
    robust = fit(line([errors], noise=0.1), train=[0], loss="soft_l1")
    assert not all(covered(pulled.interval_95)) or max(pulled.std.values()) > 0.05
    assert abs(pulled.values["offset"] - 1) > 0.3
    assert abs(robust.values["offset"] - 1) < 0.05
    assert abs(robust.values["gain"] - 2) < 0.03


def test_only_the_parameters_asked_for_are_fitted() -> None:
    found = fit(line([coloured(300, 0, 1)]), ["gain"], train=[0])
    assert found.values["offset"] == 0
    assert list(found.std) == ["gain"]
    assert to_json(found, format="f", law="l")["parameters"]["offset"]["identifiable"] is None


# what is not identifiable


def wave(
    parameters: Sequence[Parameter],
    function: Callable[[Array, Array], Array],
    truth: Sequence[float],
) -> Model:
    matrix = design(1000)
    measured = function(np.array(truth), matrix[:, 0]) + coloured(1000, 0, 7, 0.05)
    return Model(parameters, lambda v: function(v, matrix[:, 0]), [measured], noise=0.05)


A, B = parameter("stiffness", 1.0, 0, 100, "N/m"), parameter("stretch", 1.0, 0, 10, "m")
OFFSET = parameter("offset", 0, -5, 5)


@pytest.mark.parametrize(
    ("parameters", "function", "known"),
    [
        ((A, B, OFFSET), lambda v, x: v[0] * v[1] * x + v[2], "the product stiffness · stretch"),
        (
            (A, parameter("stretch", 1, 0.1, 10, "m"), OFFSET),
            lambda v, x: v[0] / v[1] * x + v[2],
            "the ratio stiffness / stretch",
        ),
        (
            (A, parameter("stretch", 1, 0.1, 10, "m"), OFFSET),
            lambda v, x: v[0] / v[1] ** 2 * x + v[2],
            "stiffness / stretch^2",
        ),
        (
            (parameter("mu", 1, 0, 10), parameter("nu", 2, 0, 10), OFFSET),
            lambda v, x: (v[0] + v[1]) * x + v[2],
            "the sum mu + nu",
        ),
        (
            (parameter("mu", 1, 0, 10), parameter("nu", 2, 0, 10), OFFSET),
            lambda v, x: (v[0] - v[1]) * x + v[2],
            "the difference mu - nu",
        ),
    ],
)
def test_parameters_that_are_identifiable_in_combination_only_are_named_with_it(
    parameters: Sequence[Parameter], function: Callable[[Array, Array], Array], known: str
) -> None:
    found = fit(wave(parameters, function, (2.0, 3.0, 0.5)), train=[0])
    found_out = found.identifiability
    assert found_out.identifiable == {parameters[0].name: False, parameters[1].name: False, "offset": True}
    (combination,) = found_out.combinations
    assert set(combination.names) == {parameters[0].name, parameters[1].name}
    assert combination.known == known
    assert combination.known in found_out.statements[0]
    assert all(name in found_out.statements[0] for name in combination.names)
    assert "offset" not in found_out.statements[0]
    value, interval = found.values[parameters[0].name], found.interval_95[parameters[0].name]
    assert interval == (parameters[0].lower, parameters[0].upper)
    assert parameters[0].lower <= value <= parameters[0].upper


def test_a_parameter_on_which_nothing_depends_is_named_alone() -> None:
    found = fit(wave((A, B, OFFSET), lambda v, x: v[0] * x + v[2], (2, 3, 0.5)), train=[0])
    assert found.identifiability.identifiable == {"stiffness": True, "stretch": False, "offset": True}
    assert found.identifiability.combinations[0].names == ("stretch",)
    assert "no sample depends on it" in found.identifiability.statements[0]
    assert to_json(found, format="f", law="l")["parameters"]["stretch"]["std"] is None


def test_advice_of_the_model_goes_into_the_statement() -> None:
    problem = wave((A, B, OFFSET), lambda v, x: v[0] * v[1] * x + v[2], (2, 3, 0.5))
    problem.advice = lambda names: f"Pull {' with '.join(sorted(names))}."  # type: ignore[attr-defined]
    found = fit(problem, train=[0])
    assert found.identifiability.statements[0].endswith("Pull stiffness with stretch.")


def test_holding_one_of_a_product_identifies_the_other() -> None:
    problem = wave((A, B, OFFSET), lambda v, x: v[0] * v[1] * x + v[2], (2, 3, 0.5))
    found = fit(problem, ["stiffness", "offset"], train=[0])
    assert found.values["stiffness"] == pytest.approx(6, abs=0.02)
    assert all(found.identifiability.identifiable.values())
    assert found.identifiability.statements == ()


@pytest.mark.parametrize(("side", "lower", "upper", "bound"), [("upper", 0, 1.5, 1.5), ("lower", 2.5, 9, 2.5)])
def test_a_parameter_at_its_bound_is_said_to_be(side: str, lower: float, upper: float, bound: float) -> None:
    parameters = (parameter("gain", 0.5 * (lower + upper), lower, upper), OFFSET)
    found = fit(wave(parameters, lambda v, x: v[0] * x + v[1], (2, 0.5)), train=[0])
    assert found.values["gain"] == bound
    assert found.identifiability.at_bound == {"gain": side}
    assert any(f"gain is at its {side} bound" in sentence for sentence in found.identifiability.statements)
    assert bound in found.interval_95["gain"]
    assert found.values["offset"] == pytest.approx(0.5, abs=0.02)


def test_runs_without_excitation_are_refused_with_the_reason() -> None:
    still = Model(LINE, lambda v: np.full(500, v[1]), [1 + coloured(500, 0, 1)])
    with refused("fit", kind=IdentificationError, allowed="excited by the recordings"):
        fit(still, train=[0])
    dead = Model(LINE, lambda v: np.zeros(500) + 0 * v[0], [coloured(500, 0, 1)])
    with refused("fit", kind=IdentificationError, allowed="excited by the recordings"):
        fit(dead, train=[0])


def test_noise_that_drowns_everything_is_no_excitation() -> None:
    with refused("fit", kind=IdentificationError, allowed="excited by the recordings"):
        fit(line([coloured(100, 0, 1, 300.0)], noise=300), train=[0])


def test_too_few_samples_are_refused_by_number() -> None:
    with refused("samples", 19, kind=IdentificationError):
        fit(line([coloured(19, 0, 1)]), train=[0])


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"train": []}, "train is empty"),
        ({"train": [0, 0]}, "test is 0; it must be given once among train and test"),
        ({"test": [0]}, "test is 0; it must be given once"),
        ({"test": [2]}, "test is 2; it must be 0 to 1"),
        ({"free": ["gian"]}, "'gian', which is no parameter; it must name some of gain, offset"),
        ({"free": []}, "free is empty"),
        ({"starts": 0}, "starts is 0"),
        ({"bootstrap": 3}, "bootstrap is 3; it must be 0"),
        ({"loss": "huber"}, "loss is 'huber'; it must be linear or soft_l1"),
        ({"derivatives": "none"}, "derivatives is 'none'"),
    ],
)
def test_what_cannot_be_asked_is_refused(changes: dict[str, object], reason: str) -> None:
    problem = line([coloured(100, 0, 1), coloured(100, 0, 2)])
    with pytest.raises(IdentificationError, match=reason):
        fit(problem, **({"train": [0]} | changes))  # type: ignore[arg-type]


def test_a_start_outside_its_bounds_and_a_model_without_an_answer_are_refused() -> None:
    outside = Model((parameter("gain", 20, -10, 10),), lambda v: design(100) @ [v[0], 0], [coloured(100, 0, 1)])
    with refused("gain", 20, kind=IdentificationError):
        fit(outside, train=[0])
    silent = Model(LINE, lambda _: np.full(100, np.nan), [coloured(100, 0, 1)])
    with refused("residuals", kind=IdentificationError, allowed="finite"):
        fit(silent, train=[0])


def test_a_start_without_an_answer_does_not_stop_the_others() -> None:
    matrix = design(300)
    measured = matrix @ TRUTH + coloured(300, 0, 1)
    # no answer at negative gain, as below zero friction
    problem = Model(LINE, lambda v: matrix @ v if v[0] > 0 else np.full(300, np.nan), [measured])
    found = fit(problem, train=[0], starts=8)
    assert found.values["gain"] == pytest.approx(2, abs=0.3)
    assert np.isinf(found.costs).any()


# the pieces


def test_long_run_covariance_is_that_of_an_autoregression() -> None:
    root, count = 0.8, 4000
    estimates = [long_run([coloured(count, root, n)[:, None]])[0, 0] for n in range(30)]
    # variance of the sum of n samples with unit variance: n (1 + root) / (1 - root)
    assert np.mean(estimates) == pytest.approx(count * (1 + root) / (1 - root), rel=0.1)


def test_sensors_that_err_together_are_not_taken_for_independent_ones() -> None:
    errors, column = coloured(2000, 0, 1), np.ones((2000, 1))
    one = estimate([Linearised(errors, column)])
    twice = Linearised(np.tile(errors, 2), np.tile(column, (2, 1)), channels=2)
    assert estimate([twice]).std[0] == pytest.approx(one.std[0], rel=0.01)
    assert estimate([twice]).white_std[0] == pytest.approx(one.white_std[0] / np.sqrt(2), rel=0.01)


def test_nothing_is_known_better_than_if_residuals_were_independent() -> None:
    column = np.ones((2000, 1))
    swinging = Linearised(np.tile([1.0, -1.0], 1000), column)
    assert estimate([swinging]).std[0] == pytest.approx(estimate([swinging]).white_std[0])


def test_errors_that_last_come_on_top_of_those_that_residuals_show() -> None:
    errors, column = coloured(2000, 0, 1), np.ones((2000, 1))
    bare = estimate([Linearised(errors, column)])
    lasting = estimate([Linearised(errors, column, systematic=np.full((2000, 1), 0.3))])
    assert lasting.std[0] == pytest.approx(np.hypot(bare.std[0], 0.3))


def test_whiteness_distinguishes_white_from_coloured_noise_and_gives_its_correlation_time() -> None:
    white = [whiteness(coloured(3000, 0, n), run="a", channel=0, sample_time=STEP) for n in range(100)]
    assert np.sum([one.white for one in white]) >= 95
    assert np.mean([one.p_value for one in white]) == pytest.approx(0.5, abs=0.1)
    red = whiteness(coloured(20000, 0.9, 1), run="a", channel=0, sample_time=STEP)
    assert not red.white
    assert red.correlation_time == pytest.approx(STEP * 1.9 / 0.1, rel=0.15)
    assert red.effective_samples == pytest.approx(20000 / 19, rel=0.15)
    assert correlation_samples(autocorrelation(np.ones(50))) == 1


def test_blocks_keep_the_correlation_and_the_sensors_together() -> None:
    assert block_length(coloured(2000, 0.95, 1)) > block_length(coloured(2000, 0.5, 1)) > 1
    assert block_length(coloured(200, 0.99, 1)) <= 200 // 8
    errors = coloured(4000, 0.9, 1)
    drawn = resampled(np.tile(errors, 2), 2, 200, np.random.default_rng(0)).reshape(2, -1)
    assert (drawn[0] == drawn[1]).all()
    assert autocorrelation(drawn[0], 1)[1] == pytest.approx(0.9, abs=0.03)
    assert set(np.round(drawn[0], 9)) <= set(np.round(errors - errors.mean(), 9))
