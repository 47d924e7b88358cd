"""Claims about the figures of instruments and runs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import tenodesis as tn
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument, InstrumentLike
from tenodesis.report import curves, style
from tenodesis.run import Run

from .conftest import EXAMPLES

PNG = b"\x89PNG\r\n"
STATICS = ("input_output", "loss", "tension", "transmissibility")


@pytest.fixture(scope="module")
def run() -> Run:
    """Return a load that comes, goes and comes again, the handle bent by 0.1 rad in between."""
    inst = tn.load("scaled-up")
    phases = (
        tn.simulate.StepLoad(delay=0.1, force=1.0, duration=0.3, release=0.1),
        tn.simulate.StepLoad(handle_angle=0.1, force=0.5, rise=0.02, duration=0.2),
    )
    return tn.simulate.execute(tn.twin.Twin(inst), tn.simulate.Protocol(name="steps", phases=phases))


def drawn(figure: Figure) -> list[np.ndarray[Any, Any]]:
    return [np.asarray(line.get_ydata(), float) for axis in figure.axes for line in axis.get_lines()]


@pytest.mark.parametrize("name", STATICS)
@pytest.mark.parametrize("inst", ["real-size", EXAMPLES / "continuum.toml"], ids=str)
def test_statics_are_drawn_in_the_reports_style_and_shown_by_notebooks(name: str, inst: InstrumentLike) -> None:
    figure = getattr(tn.plot, name)(inst)
    assert figure._repr_png_().startswith(PNG)
    assert figure.axes[0].spines["top"].get_visible() is False
    assert figure.axes[0].xaxis.label.get_color() == style.INK
    assert any(np.isfinite(values).any() for values in drawn(figure))


def test_the_curves_are_those_of_the_statics(real: Instrument) -> None:
    handle = np.linspace(0, min(real.handle_range, 1.3 * tn.statics.reach(real)), 301)
    output = np.degrees(tn.statics.output_angle(real, handle, 0.7))
    lines = drawn(tn.plot.input_output("real-size", forces=[0.7]))
    assert any(values.shape == output.shape and np.nanmax(np.abs(values - output)) < 1e-9 for values in lines)


def test_own_forces_name_their_curves(real: Instrument) -> None:
    for name in STATICS:
        legend = getattr(tn.plot, name)(real, forces=[0.0, 0.25]).axes[0].get_legend()
        assert "0.25 N" in [text.get_text() for text in legend.get_texts()]


def test_an_estimate_with_a_slack_tendon_is_a_curve_of_its_own_and_no_band(run: Run, scaled: Instrument) -> None:
    slack = np.tile([60.0, 0.0], (len(run), 1))
    quiet = replace(run, measured_tension=slack)
    loaded = replace(run, measured_tension=slack + np.random.default_rng(0).normal(0, [[0.0, 0.02]], slack.shape))
    found, expected = (curves.estimated_output_angle(scaled, one) for one in (loaded, quiet))
    assert np.array_equal(found, expected)
    (axis,) = tn.plot.hysteresis(loaded, scaled).axes
    solid = [line for line in axis.lines if line.get_linestyle() == "-"]
    assert sum(not np.isfinite(line.get_ydata()).any() for line in solid) == 1


def test_hysteresis_shows_what_was_measured_beside_theory(run: Run, scaled: Instrument) -> None:
    figure = tn.plot.hysteresis(run, scaled)
    assert figure.axes[0].get_title() == "up to 1 N"
    measured = np.degrees(run["measured_output_angle"])
    assert any(values.shape == measured.shape and (values == measured).all() for values in drawn(figure))
    assert figure._repr_png_().startswith(PNG)


def test_a_step_response_ends_with_its_load(run: Run, scaled: Instrument) -> None:
    figure = tn.plot.step_response(run, scaled)
    theory, output = drawn(figure)[:2]
    loaded = (run["force"] > 0) & (run.time < 0.45)
    assert np.isfinite(theory).sum() == loaded.sum()
    expected = np.degrees(tn.statics.output_angle(scaled, 0.0, 1.0))
    np.testing.assert_allclose(theory[np.isfinite(theory)], expected, atol=0.01)
    np.testing.assert_array_equal(output, np.degrees(run["output_angle"][: output.size]))


def test_a_run_without_a_step_has_no_step_response(run: Run, scaled: Instrument) -> None:
    with pytest.raises(ArgumentError, match="run has a constant force; it must have a load that comes"):
        tn.plot.step_response(run.rows(0, 50), scaled)


def test_a_run_draws_its_angles_tensions_and_forces(run: Run) -> None:
    figure = run.plot()
    assert [axis.get_ylabel() for axis in figure.axes] == ["angle [deg]", "tension [N]", "force [N]"]
    labels = [text.get_text() for text in figure.axes[1].get_legend().get_texts()]
    assert labels == ["measured tension, agonist", "measured tension, antagonist"]
    np.testing.assert_array_equal(figure.axes[2].get_lines()[0].get_ydata(), run["force"])


def test_named_signals_are_drawn_for_each_axis() -> None:
    both = tn.twin.Twin("real-size").run(np.zeros((40, 2)), np.ones(40))
    figure = both.plot("output_velocity", "spool_velocity")
    assert len(figure.axes) == 4
    assert figure.axes[0].get_ylabel() == "speed [deg/s]"
    np.testing.assert_allclose(
        figure.axes[1].get_lines()[0].get_ydata(), np.degrees(both["output_velocity"][:, 1]), rtol=1e-12
    )


def test_an_unknown_signal_is_named(run: Run) -> None:
    with pytest.raises(KeyError):
        run.plot("tip_angle")


def test_a_figure_is_saved_in_its_style_whatever_the_users_settings(real: Instrument, tmp_path: Path) -> None:
    import matplotlib as mpl

    figure = tn.plot.loss(real)
    figure.savefig(tmp_path / "own.png")
    with mpl.rc_context({"font.size": 30, "xtick.color": "red"}):
        figure.savefig(tmp_path / "changed.png")
    assert (tmp_path / "own.png").read_bytes() == (tmp_path / "changed.png").read_bytes()


def test_the_onset_of_slack_is_where_the_antagonist_has_no_tension(real: Instrument) -> None:
    output, handle = curves.slack_onset(real, 2.0)
    assert tn.statics.tensions(real, handle, 2.0).antagonist == pytest.approx(0, abs=0.05)
    assert tn.statics.output_angle(real, handle, 2.0) == pytest.approx(output, abs=1e-6)
