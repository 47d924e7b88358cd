"""Mistakes of a laboratory in recordings of twins: named, and no interval that is called identifiable lies."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tenodesis as tn
from tenodesis.errors import ArgumentError, IdentificationError
from tenodesis.identification import arrays, mistakes
from tenodesis.identification.formats import csv
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Problem
from tenodesis.instrument import ShortForm, as_short_form
from tenodesis.units import STANDARD_GRAVITY

from .twin_recordings import NOMINAL, TRUE, TRUTH, problem, recorded

FREE = list(TRUTH)


def scaled(run: InstrumentRun, factor: float, *columns: str) -> InstrumentRun:
    return dataclasses.replace(run, columns={**run.columns, **{name: factor * run[name] for name in columns}})


def explained(run: InstrumentRun, free: Sequence[str] = FREE) -> mistakes.Explanation | None:
    def build(runs: Sequence[MeasuredRun], other: ShortForm | None) -> Problem:
        return problem([one for one in runs if isinstance(one, InstrumentRun)], other or NOMINAL)

    return mistakes.explain([run], build, lambda _: free)


def swapped(run: InstrumentRun) -> InstrumentRun:
    pair = {"tension_agonist": run["tension_antagonist"], "tension_antagonist": run["tension_agonist"]}
    return dataclasses.replace(run, columns={**run.columns, **pair})


MISTAKES: dict[str, Callable[[InstrumentRun], InstrumentRun]] = {
    "the force has its sign reversed": lambda run: scaled(run, -1.0, "force"),
    "the output angle is in radians, read as degrees": lambda run: scaled(run, np.radians(1), "measured_output_angle"),
    "the columns of the two tendons are swapped": swapped,
    "the tensions are in kgf, not in N": lambda run: scaled(
        run, 1 / STANDARD_GRAVITY, "tension_agonist", "tension_antagonist"
    ),
    "the time is in ms, not in s": lambda run: dataclasses.replace(run, time=1e3 * run.time),
    "the handle angle has its sign reversed": lambda run: scaled(run, -1.0, "handle_angle", "measured_handle_angle"),
}


@pytest.mark.slow
@pytest.mark.parametrize("named", MISTAKES)
def test_a_mistake_is_named_with_what_it_would_give(named: str) -> None:
    found = explained(MISTAKES[named](recorded(TRUE, seconds=0.5)))
    assert found is not None
    assert found.sentence == named
    assert found.values["pretension_ratio"] == pytest.approx(1.1, abs=0.01)
    assert found.left * mistakes.EXPLAINS < found.left_as_given


@pytest.mark.slow
def test_a_recording_of_another_instrument_is_named() -> None:
    others = {name: as_short_form(tn.load(name)).planar[0] for name in ("real-size", "scaled-up")}

    def build(runs: Sequence[MeasuredRun], other: ShortForm | None) -> Problem:
        inst = other or others["real-size"]
        return problem([one for one in runs if isinstance(one, InstrumentRun)], inst.replace(mismatch=None))

    found = mistakes.explain([recorded(TRUE, seconds=0.5)], build, lambda _: FREE, instruments=others)
    assert found is not None
    assert found.sentence == "the recording is of another instrument: scaled-up"


@pytest.mark.slow
def test_a_parameter_held_at_a_wrong_value_is_named() -> None:
    held = [name for name in FREE if name != "stiffness_ratio"]
    found = explained(recorded(TRUE, seconds=0.5), held)
    assert found is not None
    assert found.sentence == "stiffness_ratio is held at a wrong value"


@pytest.mark.slow
def test_arrays_are_fitted_and_nothing_is_identifiable_of_swapped_tensions() -> None:
    run = recorded(TRUE, seconds=1.0)
    table = pd.DataFrame(dict(run.columns))
    pair = ["tension_agonist", "tension_antagonist"]

    def fitted(order: list[str]) -> tn.identification.Fit:
        return tn.identification.fit(
            time=pd.Series(run.time),
            handle_angle=table.handle_angle,
            tension=table[order],
            output_angle=table.measured_output_angle,
            force=table.force,
            instrument=TRUE,
            free=FREE,
            starts=1,
        )

    wrong = fitted(pair[::-1])
    assert not any(wrong.identifiability.identifiable.values())
    assert "swapped" in wrong.warnings[1]
    low, high = wrong.interval_95["friction.vertex_coefficient"]
    assert low <= 0.13 <= high
    assert list(wrong.to_pandas().index) == list(wrong.free)
    assert len(wrong.curves()) == next(iter(wrong.traces.values())).time.size


def test_arrays_of_other_lengths_are_refused_by_name() -> None:
    with pytest.raises(ArgumentError, match="tension has shape") as caught:
        tn.identification.fit(time=[0, 1, 2], handle_angle=[0, 1, 2], tension=[1, 2], instrument="scaled-up")
    assert caught.value.key == "tension"


def test_radians_under_degrees_are_found_in_both_columns_of_angles(tmp_path: Path) -> None:
    run = recorded(TRUE, seconds=1.0)
    path = tmp_path / "log.csv"
    columns = ("handle_angle", "measured_output_angle", "tension_agonist", "tension_antagonist")
    small = run["handle_angle"], run["measured_output_angle"]
    data = np.column_stack([run.time, *small, *(run[name] for name in columns[2:])])
    headings = "time [s],handle_angle [deg],measured_output_angle [deg],tension_agonist [N],tension_antagonist [N]"
    np.savetxt(path, data, delimiter=",", header=headings, comments="")
    read = csv.load(path)
    for name in columns[:2]:
        assert np.ptp(read[name]) == pytest.approx(np.ptp(run[name]), rel=1e-6)


def test_a_value_of_an_instrument_cannot_be_set() -> None:
    with pytest.raises(ArgumentError, match="replace") as caught:
        NOMINAL.pretension = 3  # type: ignore[misc]
    assert caught.value.key == "pretension"


def test_recordings_that_are_refused_name_the_mistake_and_keep_the_reason() -> None:
    def refuse() -> Problem:
        raise IdentificationError("time ends at 1000 s.", key="time", value=1000.0)

    said = mistakes.Explanation("the time is in ms, not in s", 1.0, np.inf, {"stiffness_ratio": 0.85})
    with pytest.raises(IdentificationError, match=r"ends at 1000 s\. Most likely the time is in ms") as caught:
        mistakes.answered(refuse, lambda: said)
    assert caught.value.key == "time"
    with pytest.raises(IdentificationError, match=r"1000 s\.$"):
        mistakes.answered(refuse, lambda: None)


def test_a_fit_that_is_refused_names_the_mistake_that_led_it_astray(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> tn.identification.Fit:
        raise IdentificationError("no excitation.", key="fit")

    said = mistakes.Explanation("the force has its sign reversed", 1.0, 210.0, {})
    monkeypatch.setattr(arrays, "fit_problem", refuse)
    monkeypatch.setattr(mistakes, "explain", lambda *_, **__: said)
    run = recorded(TRUE, seconds=0.5)
    tension = np.stack([run["tension_agonist"], run["tension_antagonist"]], axis=1)
    with pytest.raises(IdentificationError, match=r"no excitation\. Most likely the force"):
        tn.identification.fit(time=run.time, handle_angle=run["handle_angle"], tension=tension, instrument=TRUE)
