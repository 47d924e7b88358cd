"""Claims about campaigns: rows in order, whatever they are shared out over, kept and taken up again; tables."""

import json
import math
import os
from pathlib import Path
from typing import Any

import pytest

from tenodesis.errors import NoSolutionError, StudyError
from tenodesis.simulate import campaign

CASES = campaign.cases(mass=(1.0, 2.0), seed=range(3))


def trial(mass: float, seed: int) -> dict[str, Any]:
    return {"force": mass * seed, "faults": ["late"] if seed == 2 else []}


def test_cases_are_all_combinations_and_the_last_name_changes_fastest() -> None:
    assert [(case["mass"], case["seed"]) for case in CASES] == [(m, s) for m in (1.0, 2.0) for s in range(3)]


@pytest.mark.parametrize("on", ["threads", pytest.param("processes", marks=pytest.mark.process)])
def test_rows_are_the_cases_with_their_metrics_in_order(on: Any) -> None:
    rows = campaign.run(trial, CASES, on=on)
    assert list(rows) == [case | trial(**case) for case in CASES]
    assert rows["force"].tolist() == [0, 1, 2, 0, 2, 4]
    assert [len(group) for group in rows.by("seed").values()] == [2, 2, 2]
    assert rows.where(mass=2.0, seed=1)[0]["force"] == 2


def threads_of_algebra(seed: int) -> dict[str, Any]:
    return {"threads": os.environ.get("OPENBLAS_NUM_THREADS", "all"), "next": seed + 1}


@pytest.mark.process
def test_linear_algebra_of_a_process_has_one_thread_unless_the_environment_says_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    for asked, had in ((None, "1"), ("3", "3")):
        if asked:
            monkeypatch.setenv("OPENBLAS_NUM_THREADS", asked)
        rows = campaign.run(threads_of_algebra, campaign.cases(seed=range(2)))
        assert {row["threads"] for row in rows} == {had}
        assert os.environ.get("OPENBLAS_NUM_THREADS") == asked


def test_what_joints_cannot_hold_has_no_row_and_an_error_names_its_case() -> None:
    def falls(seed: int) -> dict[str, Any]:
        if seed == 1:
            raise NoSolutionError("the joint folds")
        if seed == 3:
            raise ZeroDivisionError
        return {"angle": 1.0}

    assert campaign.run(falls, campaign.cases(seed=range(3)), on="threads")["seed"].tolist() == [0, 2]
    with pytest.raises(ZeroDivisionError) as raised:
        campaign.run(falls, campaign.cases(seed=(3,)), on="threads")
    assert "{'seed': 3}" in raised.value.__notes__[0]


def test_a_campaign_that_was_stopped_goes_on_where_it_was(tmp_path: Path) -> None:
    path, calls, told = tmp_path / "results.json", [], []

    def stops(mass: float, seed: int) -> dict[str, Any]:
        calls.append((mass, seed))
        if len(calls) == 4:
            raise KeyboardInterrupt
        return trial(mass, seed)

    with pytest.raises(KeyboardInterrupt):
        campaign.run(stops, CASES, results=path, on="threads")
    kept = len(json.loads(path.read_text())["rows"])
    assert 0 < kept < len(CASES)
    before = len(calls)
    rows = campaign.run(stops, CASES, results=path, on="threads", progress=lambda *done: told.append(done))
    assert len(calls) - before == len(CASES) - kept
    assert told[0] == (kept + 1, len(CASES))
    assert told[-1] == (len(CASES), len(CASES))
    assert list(rows) == [case | trial(**case) for case in CASES]
    assert [entry.name for entry in tmp_path.iterdir()] == ["results.json"]


def test_results_of_another_trial_or_that_are_none_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    campaign.run(trial, CASES, results=path, on="threads")
    with pytest.raises(StudyError, match=r"results with trial .*trial, this campaign .*lambda"):
        campaign.run(lambda **_: {}, CASES, results=path, on="threads")
    for place in (tmp_path, tmp_path / "absent/results.json"):
        with pytest.raises(StudyError, match=r"cannot be (read|written)"):
            campaign.run(trial, CASES, results=place, on="threads")
    path.write_text("[]")
    with pytest.raises(StudyError, match="cannot be read as results of a campaign"):
        campaign.run(trial, CASES, results=path, on="threads")
    assert path.read_text() == "[]"


def test_a_table_has_a_line_for_each_group_and_a_verdict_names_the_worst() -> None:
    rows = campaign.Rows({**case, **trial(**case), "words": f"#{case['seed']}"} for case in CASES)
    columns = [
        campaign.Column("runs", len, form="d"),
        campaign.Column("RMS", "force", campaign.rms),
        campaign.Column("worst", "force", campaign.farthest, ".0f"),
        campaign.Column("faults", "faults", campaign.names),
    ]
    first, second, third = campaign.table(rows.by("mass"), columns, "kg").splitlines()
    assert first.split() == ["kg", "runs", "RMS", "worst", "faults"]
    assert second.split() == ["1.0", "3", f"{math.sqrt(5 / 3):.2f}", "2", "late"]
    assert len(second) == len(third)
    assert campaign.verdict("above 1 N", rows, "force", 1) == (
        "  above 1 N: 3 of 6   target 0   MISSED\n    +4.00: #2\n    +2.00: #2\n    +2.00: #1"
    )
    assert campaign.verdict("above 4 N", rows, "force", 4).endswith("reached")
