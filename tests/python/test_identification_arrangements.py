"""Which arrangement of contacts a recording asks for."""

from collections.abc import Sequence

import numpy as np
import pytest

from tenodesis.identification import fit
from tenodesis.identification.comparison import ArrangementComparison, Fitted, compare_arrangements
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.twin_model.formats import arrangements
from tenodesis.instrument import Instrument
from tenodesis.instrument.compliance import compliance_shares

from .twin_recordings import NOMINAL, TRUE, TRUTH, problem, recorded

NAMES = (
    "one vertex a joint",
    "two vertices a joint",
    "one vertex a joint, base wrap",
    "two vertices a joint, base wrap",
)
ASKED = ["stiffness_ratio", "friction.vertex_coefficient", "friction.sheath_coefficient"]


def compared(run: InstrumentRun, only: Sequence[str] = ()) -> ArrangementComparison:
    """Return the arrangements of which a recording is fitted with three parameters, all of them unless named."""
    options = arrangements([run], law="capstan", instrument=NOMINAL, fitted=ASKED)

    def fitted(name: str, carefully: bool) -> Fitted:
        option = next(one for one in options if one.name == name)
        built = problem(run, option.instrument)
        return Fitted(built, fit(built, [*ASKED, *option.unknowns], train=[0], starts=1, refine=carefully))

    names = [one.name for one in options if not only or one.name in only or one is options[0]]
    return compare_arrangements(names[0], names[1:], fitted, train=[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"friction.vertices_per_joint": 2}, "two vertices a joint"),
        ({"friction.vertices_per_joint": 2, "friction.base_wrap": 0.3}, "two vertices a joint, base wrap"),
        ({"friction.base_wrap": 0.3}, "one vertex a joint, base wrap"),
        ({}, "one vertex a joint"),
    ],
)
def test_a_recording_asks_for_its_arrangement_and_has_its_coefficients(changes: dict[str, float], name: str) -> None:
    built = TRUE.replace(**{"mismatch.pretension_ratio": None, "mismatch.output_encoder_offset": None}, **changes)
    comparison = compared(recorded(built, seconds=1.0), NAMES)
    assert comparison.chosen == name
    assert comparison.fits
    for key in ASKED:
        assert comparison.result.values[key] == pytest.approx(TRUTH[key], rel=0.02), key
    assert comparison.result.train_rmse["output_angle_deg"] < 0.1
    assert comparison.statements[0].startswith("The recordings ask for" if changes else "Of 4 arrangements")
    if changes:
        wrong = comparison["one vertex a joint"]
        assert wrong.bic > 100
        low, high = wrong.fit.interval_95["friction.vertex_coefficient"]
        assert not low < TRUTH["friction.vertex_coefficient"] < high


@pytest.mark.slow
def test_where_no_arrangement_fits_it_is_said_and_intervals_are_those_of_all() -> None:
    rubbing = {"friction.law": "stribeck", "friction.constant": 2.0, "friction.static_ratio": 2.0}
    run = recorded(TRUE.replace(**{"friction.stribeck_speed": 1e-3}, **rubbing), seconds=1.0)
    comparison = compared(run, NAMES)
    assert not comparison.fits
    assert "No arrangement fits" in comparison.statements[1]
    assert set(comparison.statements) <= set(comparison.result.warnings)
    for row in comparison.rows:
        for key in ASKED:
            low, high = comparison.result.interval_95[key]
            assert low <= row.fit.interval_95[key][0] and row.fit.interval_95[key][1] <= high
    key = "friction.vertex_coefficient"
    assert np.ptp(comparison.result.interval_95[key]) > 1.4 * np.ptp(comparison[comparison.chosen].fit.interval_95[key])


def test_an_arrangement_is_not_asked_for_without_friction_nor_where_the_stem_would_have_no_compliance() -> None:
    def names(inst: Instrument, law: str = "capstan") -> list[str]:
        run = recorded(NOMINAL, seconds=0.5)
        return [one.name for one in arrangements([run], law=law, instrument=inst, fitted=ASKED)]

    assert names(NOMINAL, "none") == ["one vertex a joint"]
    assert len(names(NOMINAL)) == 8
    joints = sum(compliance_shares(NOMINAL)[1::2])
    full = NOMINAL.replace(**{"friction.handle_compliance_share": 1 - joints - 1e-3})
    assert not any(name.startswith("two") for name in names(full))
