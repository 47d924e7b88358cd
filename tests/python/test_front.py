"""Claims about fronts as sequences: slices, masks, sorting, iteration."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.scaling import Front, Objectives

from .conftest import refused


@pytest.fixture(scope="module")
def front() -> Front:
    return tn.scaling.design("real-size", combinations=2000)


def test_a_slice_is_a_front_of_those_designs_and_iterating_gives_them(front: Front) -> None:
    first = front[:3]
    assert isinstance(first, Front)
    assert first.objectives == front.objectives[:3]
    assert front[::-1].objectives == front.objectives[::-1]
    designs = [design.choice for design in first]
    assert len(designs) == 3
    assert designs[1] == front[1].choice
    assert designs[2] == first[-1].choice
    with pytest.raises(IndexError):
        first[3]


def test_a_mask_and_indices_choose_designs(front: Front) -> None:
    small = [one.overall_length < 1.0 for one in front.objectives]
    chosen = front[small]
    assert 0 < len(chosen) < len(front)
    assert all(one.overall_length < 1.0 for one in chosen.objectives)
    assert front[np.array(small)].objectives == chosen.objectives
    assert front[np.flatnonzero(small)].objectives == chosen.objectives
    assert front[[2, 0]].objectives == (front.objectives[2], front.objectives[0])
    assert len(front[[]]) == len(front[np.zeros(len(front), bool)]) == 0


def test_a_mask_of_another_length_is_refused(front: Front) -> None:
    with pytest.raises(IndexError):
        front[[True, False]]


@pytest.mark.parametrize("objective", Objectives._fields)
def test_sorting_puts_the_best_first(front: Front, objective: str) -> None:
    values = [getattr(one, objective) for one in front.sorted_by(objective).objectives]  # type: ignore[arg-type]
    assert values == sorted(values, reverse=objective == "tension_margin")
    assert len(values) == len(front)


def test_an_unknown_objective_is_refused(front: Front) -> None:
    with refused("objective", "cost"):
        front.sorted_by("cost")  # type: ignore[arg-type]


def test_what_is_best_of_a_part_is_of_that_part(front: Front) -> None:
    part = front[3:]
    assert part.objectives[part.best("size")].overall_length == min(one.overall_length for one in part.objectives)
