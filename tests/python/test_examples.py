"""The examples that search: what they find is no worse than where they began, and repeats."""

import json
from pathlib import Path

import numpy as np
import pytest

from .conftest import EXAMPLES, load_file

pytestmark = pytest.mark.slow


def test_the_tuned_law_is_no_worse_in_training_than_the_shipped_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tune_law = load_file(EXAMPLES / "tune_law.py")
    every, out = tune_law.cases, tmp_path / "tuned.json"
    monkeypatch.setattr(tune_law, "AFTER", 1.0)
    monkeypatch.setattr(tune_law, "cases", lambda inst, held_out: every(inst, held_out)[1::37])
    found = tune_law.main(["--generations", "1", "--population", "5", "--out", str(out)])
    shipped, tuned, off = (
        found["training"][name] for name in ("robust law as shipped", "robust law tuned", "motors off")
    )
    assert tuned.objective <= shipped.objective < off.objective and off.harm == 0
    control = json.loads(out.read_text("utf-8"))
    assert set(control) == {f"control.{key}" for key in tune_law.SEARCHED}


def test_a_policy_repeats_by_seed_and_laws_are_judged_on_its_episodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    train_policy = load_file(EXAMPLES / "train_policy.py")
    arguments = ["--iterations", "2", "--directions", "2", "--episodes", "2", "--held-out", "4"]
    arguments += ["--out", str(tmp_path / "policy.npz")]
    for name, duration in {"TASK": 2.5, "OTHER": 1.0}.items():
        monkeypatch.setattr(train_policy, name, train_policy.gym.Task(tissue=0.0, duration=duration))
    policy, tables = train_policy.main(arguments)
    np.testing.assert_array_equal(policy, train_policy.main(arguments)[0])
    assert train_policy.main([*arguments, "--trained"])[1] == tables
    table = tables["the task trained for"]
    assert table["robust law as shipped"].rms < table["motors off"].rms and table["motors off"].worse == 0


def test_a_policy_treats_both_tendons_alike() -> None:
    train_policy = load_file(EXAMPLES / "train_policy.py")
    random = np.random.default_rng(0)
    policies, observed = random.normal(size=(3, sum(train_policy.SIZES))), random.normal(size=(5, 3, 7))
    mirrored = observed[..., train_policy.MIRROR] * np.array([-1, 1, 1, 1, 1, 1, 1])
    one, other = (train_policy.actions(policies, seen) for seen in (observed, mirrored))
    np.testing.assert_allclose(one, other[..., ::-1])
    assert np.abs(one[..., 0] - one[..., 1]).min() > 0
