"""Claims about bad arguments: one sentence that names argument, value and what is allowed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import TendonGear

S = tn.statics
NAN, INF = float("nan"), float("inf")

CASES: list[tuple[Callable[[TendonGear], Any], type[Exception], str]] = [
    (lambda i: S.output_angle(i, NAN), ValueError, r"^handle_angle is nan; allowed is a finite number\.$"),
    (lambda i: S.output_angle(i, 0.1, INF), ValueError, r"^force is inf; allowed is a finite number\.$"),
    (lambda i: S.output_angle(i, [0, 0.1], [1, NAN]), ValueError, r"^force\[1\] is nan"),
    (lambda i: S.output_angle(i, np.zeros((2, 2)), np.array([[0, 0], [0, NAN]])), ValueError, r"^force\[1, 1\] is nan"),
    (lambda i: S.output_angle(i, 0.1, wound=(0.0, NAN)), ValueError, r"^antagonist_wound is nan"),
    (lambda i: S.output_angle(i, 0.1, radial_force=NAN), ValueError, r"^radial_force is nan"),
    (
        lambda i: S.output_angle(i, 0.9),
        ValueError,
        r"^handle_angle is 0.9 rad \(51.5662 deg\); allowed is .* ±45 deg\.$",
    ),
    (lambda i: S.output_angle(i, [0, -0.9]), ValueError, r"^handle_angle\[1\] is -0.9 rad"),
    (lambda i: S.estimate_output_angle(i, 0.9, 30, 30), ValueError, r"^handle_angle is 0.9 rad"),
    (lambda i: S.output_angle(i, "x"), ValueError, r"^handle_angle is 'x'; allowed is a number or an array"),
    (lambda i: S.output_angle(i, None), ValueError, r"^handle_angle is (None|nan); allowed is"),
    (lambda i: S.output_angle(i, [0, 1], [1, 2, 3]), ValueError, r"^the shapes do not broadcast: handle_angle \(2,\)"),
    (lambda i: S.output_angle("real-size", 0.1), TypeError, r"^inst is 'real-size'; allowed is an instrument"),  # type: ignore[arg-type]
    (lambda i: S.handle_angle(i, 3.0), tn.NoSolutionError, r"at output_angle = 3 rad .* outside what the mechanism"),
    (lambda i: S.handle_angle(i, NAN), ValueError, r"^output_angle is nan"),
    (lambda i: S.handle_angle(i, 1.4, 2.0), tn.NoSolutionError, r"range of ±45 deg can reach\.$"),
    (lambda i: S.output_angle(i, -0.57, 1.5), tn.NoSolutionError, r"past the fold where the joint snaps through"),
    (lambda i: S.output_angle(i, 0, wound=(-2e-3, -2e-3)), tn.NoSolutionError, r"both tendons are slack"),
    (lambda i: S.estimate_output_angle(i, 0.1, 0, 0), tn.NoSolutionError, r"both tendons are slack"),
    (lambda i: S.compensation_stroke(i, 0, 40), tn.NoSolutionError, r"gives no angle back; .* pretension of 30 N\.$"),
    (lambda i: S.compensation_stroke(i, NAN, 40), ValueError, r"^agonist is nan"),
    (lambda i: S.compensation_stroke(i, 3, 4, "both"), ValueError, r"^actuation is 'both'; allowed are agonist and"),  # type: ignore[arg-type]
    (lambda i: S.compensation_stroke(i, 3, 4, law="x"), ValueError, r"^law is 'x'; allowed are exact and paper\.$"),  # type: ignore[arg-type]
    (lambda i: S.loss_of_dexterity(i, 0.1, NAN), ValueError, r"^force is nan"),
    (lambda i: S.flexural_stiffness(i, INF), ValueError, r"^output_angle is inf"),
    (lambda i: S.output_angle(i, "0.5"), ValueError, r"^handle_angle is '0.5'; allowed is a number or an array"),
    (lambda i: S.output_angle(i, np.array([0.1 + 0.2j])), ValueError, r"^handle_angle is array\(.*; allowed is a"),
    (lambda i: S.output_angle(i, np.ma.array([0.1, 99], mask=[0, 1])), ValueError, r"^handle_angle is masked_array"),
    (lambda i: S.output_angle(i, 10**400), ValueError, r"^handle_angle is 1000"),
    (lambda i: S.output_angle(i, 0.1, wound=(1e-3,)), ValueError, r"^wound is \(0.001,\); allowed is"),
    (lambda i: S.output_angle(i, 0.1, 1e308, radial_force=1e308), tn.NoSolutionError, r"no equilibrium"),
    (lambda i: S.estimate_output_angle(i, 0.1, 30, 30, slack_below=NAN), ValueError, r"^slack_below is nan"),
    (lambda i: S.compensation_stroke(i, INF, 1), ValueError, r"^agonist is inf"),
    (lambda i: S.gradient("output_angle", i, 0.1, wrt=[]), ValueError, r"^wrt is \[\]; allowed is a list of names"),
    (lambda i: S.gradient("output_angle", i, 0.1, wrt="force"), ValueError, r"^wrt is 'force'; allowed is a list"),
    (lambda i: tn.similarity.compare(i, "x"), TypeError, r"^prototype is 'x'; allowed is an instrument"),  # type: ignore[arg-type]
    (lambda i: tn.similarity.compare(i, i, largest_force="1 N"), ValueError, r"^largest_force is '1 N'"),  # type: ignore[arg-type]
    (lambda i: S.output_angle(i, 0.1, wound=1e308), ValueError, r"^agonist_wound is 1e\+308; allowed is a number"),
    (lambda _: tn.set_threads(2.5), ValueError, r"^count is 2.5; allowed is"),  # type: ignore[arg-type]
    (lambda _: tn.set_threads(2**40), ValueError, r"^count is 1099511627776; allowed is"),
    (lambda _: tn.set_threads(0), ValueError, r"^count is 0; allowed is"),
]


@pytest.mark.parametrize(("call", "kind", "sentence"), CASES)
def test_a_bad_argument_is_named(
    real: TendonGear, call: Callable[[TendonGear], Any], kind: type[Exception], sentence: str
) -> None:
    with pytest.raises(kind, match=sentence):
        call(real)
