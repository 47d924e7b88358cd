"""Claims about bad arguments: one sentence that names argument, value and what it must be."""

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.instrument import TendonGear

from .conftest import refused

S = tn.statics
NAN, INF = float("nan"), float("inf")


CASES: list[tuple[Callable[[Any], Any], str, Any]] = [
    (lambda i: S.output_angle(i, NAN), "handle_angle", NAN),
    (lambda i: S.output_angle(i, 0.1, INF), "force", INF),
    (lambda i: S.output_angle(i, [0, 0.1], [1, NAN]), "force[1]", NAN),
    (lambda i: S.output_angle(i, np.zeros((2, 2)), np.array([[0, 0], [0, NAN]])), "force[1, 1]", NAN),
    (lambda i: S.output_angle(i, 0.1, wound=(0.0, NAN)), "antagonist_wound", NAN),
    (lambda i: S.output_angle(i, 0.1, radial_force=NAN), "radial_force", NAN),
    (lambda i: S.output_angle(i, [0, -0.9]), "handle_angle[1]", -0.9),
    (lambda i: S.estimate_output_angle(i, 0.9, 30, 30), "handle_angle", 0.9),
    (lambda i: S.output_angle(i, "x"), "handle_angle", "x"),
    (lambda i: S.output_angle(i, "0.5"), "handle_angle", "0.5"),
    (lambda i: S.output_angle(i, None), "handle_angle", None),
    (lambda i: S.output_angle(i, np.array([0.1 + 0.2j])), "handle_angle", np.array([0.1 + 0.2j])),
    (lambda i: S.output_angle(i, 10**400), "handle_angle", 10**400),
    (lambda i: S.output_angle(i, 0.1, wound=(1e-3,)), "wound", (1e-3,)),
    (lambda i: S.output_angle(i, 0.1, wound=1e308), "agonist_wound", 1e308),
    (lambda i: S.handle_angle(i, NAN), "output_angle", NAN),
    (lambda i: S.compensation_stroke(i, NAN, 40), "agonist", NAN),
    (lambda i: S.compensation_stroke(i, INF, 1), "agonist", INF),
    (lambda i: S.compensation_stroke(i, 3, 4, "both"), "actuation", "both"),
    (lambda i: S.compensation_stroke(i, 3, 4, law="x"), "law", "x"),
    (lambda i: S.loss_of_dexterity(i, 0.1, NAN), "force", NAN),
    (lambda i: S.flexural_stiffness(i, INF), "output_angle", INF),
    (lambda i: S.estimate_output_angle(i, 0.1, 30, 30, slack_below=NAN), "slack_below", NAN),
    (lambda i: S.gradient("angle", i, 0.1, wrt=["force"]), "function", "angle"),
    (lambda i: S.gradient("output_angle", i, 0.1, wrt=[]), "wrt", []),
    (lambda i: S.gradient("output_angle", i, 0.1, wrt="force"), "wrt", "force"),
    (lambda i: S.gradient("output_angle", i, 0.1, wrt=["colour"]), "wrt", "colour"),
    (lambda _: tn.set_threads(2.5), "count", 2.5),  # type: ignore[arg-type]
    (lambda _: tn.set_threads(2**40), "count", 2**40),
    (lambda _: tn.set_threads(0), "count", 0),
]


@pytest.mark.parametrize(("call", "key", "value"), CASES)
def test_a_bad_argument_is_named(real: TendonGear, call: Callable[[TendonGear], Any], key: str, value: Any) -> None:
    with pytest.raises(ArgumentError) as refused:
        call(real)
    assert refused.value.key == key
    np.testing.assert_equal(refused.value.value, value)
    assert refused.value.allowed


def test_a_masked_array_is_refused(real: TendonGear) -> None:
    with refused("handle_angle", allowed="a number or an array of numbers"):
        S.output_angle(real, np.ma.array([0.1, 99], mask=[0, 1]))


def test_what_is_no_instrument_is_refused(real: TendonGear) -> None:
    with pytest.raises(TypeError):
        S.output_angle(3, 0.1)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        tn.similarity.compare(real, None)  # type: ignore[arg-type]
    with refused("file", "x", kind=InstrumentError):
        tn.similarity.compare(real, "x")
    with refused("largest_force", "1 N"):
        tn.similarity.compare(real, real, largest_force="1 N")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda i: S.output_angle(i, 0.9),
            "handle_angle is 0.9 rad (51.5662 deg); it must be within the handle's range of ±45 deg.",
        ),
        (
            lambda i: S.output_angle(i, [0, 1], [1, 2, 3]),
            "the shapes do not broadcast: handle_angle (2,), force (3,), radial_force (), agonist_wound (), "
            "antagonist_wound ().",
        ),
    ],
)
def test_the_sentence_says_what_is_needed(real: TendonGear, call: Callable[[TendonGear], Any], sentence: str) -> None:
    with pytest.raises(ArgumentError) as refused:
        call(real)
    assert str(refused.value) == sentence


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda i: S.handle_angle(i, 3.0), "at output_angle = 3 rad .* outside what the mechanism"),
        (lambda i: S.handle_angle(i, 1.4, 2.0), r"range of ±45 deg can reach\.$"),
        (lambda i: S.output_angle(i, -0.57, 1.5), "past the fold where the joint snaps through"),
        (lambda i: S.output_angle(i, 0, wound=(-2e-3, -2e-3)), "both tendons are slack"),
        (lambda i: S.estimate_output_angle(i, 0.1, 0, 0), "both tendons are slack"),
        (lambda i: S.compensation_stroke(i, 0, 40), "restores no angle; .* pretension of 30 N"),
        (lambda i: S.output_angle(i, 0.1, 1e308, radial_force=1e308), "no equilibrium"),
    ],
)
def test_a_point_without_a_solution_says_why(real: TendonGear, call: Callable[[TendonGear], Any], reason: str) -> None:
    with pytest.raises(tn.NoSolutionError, match=reason):
        call(real)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (".".join(["a"] * 40_000) + "=1", "parts"),
        (f"[{'.'.join(['a'] * 40_000)}]", "parts"),
        (" . ".join(["'a b'"] * 40_000) + "=1", "parts"),
        ("pretension=" + "9" * 5000, "64 bits"),
        ("pretension=[{a=0x" + "f" * 5000 + "}]", "64 bits"),
    ],
)
def test_a_small_file_that_would_cost_much_is_refused(text: str, says: str) -> None:
    tracemalloc.start()
    with refused("file", kind=InstrumentError) as raised:
        tn.instrument.parse(text, "bomb.toml")
    assert tracemalloc.get_traced_memory()[1] < 2e7
    tracemalloc.stop()
    assert says in str(raised.value)
