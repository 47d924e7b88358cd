"""Claims about similarity against Tables I and II and against instruments that are similar by construction."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument, TendonGear
from tenodesis.published import SCALE_FACTORS


def test_factors_of_tables_1_and_2_come_out_as_printed(real: TendonGear, scaled: TendonGear) -> None:
    factors = tn.similarity.compare(real, scaled).factors
    for key, printed in SCALE_FACTORS.items():
        if key != "loss_of_dexterity":
            # Printed with three or four digits, the last one cut off rather than rounded in places.
            assert factors[key] == pytest.approx(printed.value, rel=2.6e-3), key
    assert factors["flexural_stiffness"] == pytest.approx(3.75**2 * 0.857142857**2 / 2, rel=1e-8)


def test_loss_of_dexterity_is_equal_at_the_angle_the_factor_is_made_for(real: TendonGear, scaled: TendonGear) -> None:
    comparison = tn.similarity.compare(real, scaled)
    for angle in np.radians([0.0, 40, 80]):
        factor = comparison.force_factor(angle)
        ours = tn.statics.loss_of_dexterity(scaled, angle, factor)
        assert ours == pytest.approx(tn.statics.loss_of_dexterity(real, angle, 1.0), rel=1e-14)


def test_error_over_the_working_range_is_small_only_with_scaled_pretension(
    real: TendonGear, scaled: TendonGear
) -> None:
    errors = tn.similarity.compare(real, scaled).errors
    assert errors["scaled"].prototype_pretension == pytest.approx(41.33, abs=0.01)
    assert errors["as used"].prototype_pretension == 25
    tested = tn.similarity.compare(real, scaled).error(pretension=25.0, largest_force=0.52)
    assert tested.force.max() == 0.52
    assert tested.largest < 0.15
    assert tested.unsolved == 0
    assert errors["scaled"].rms < 0.35
    assert errors["as used"].rms > 7
    span = np.degrees(tn.statics.output_angle(real, errors["scaled"].handle_angle[[0, -1]]))
    assert span == pytest.approx([-80, 80], abs=1e-6)
    assert errors["scaled"].force[[0, -1]].tolist() == [0, 3]
    handle, force = errors["as used"].worst
    ours = tn.statics.output_angle(scaled, handle, force * errors["as used"].force_factor)
    theirs = tn.statics.output_angle(real, handle, force)
    assert abs(np.degrees(ours - theirs)) == pytest.approx(errors["as used"].largest, rel=1e-9)


def test_a_geometrically_scaled_instrument_is_similar_everywhere(any_inst: Instrument) -> None:
    """Every length times s, the same modulus: forces scale with s squared and all angles agree, folds included."""
    s = 2.5
    changes = {}
    for key, value, quantity in any_inst.quantities():
        power = {"m": 1, "N": 2, "N*m^2": 4}.get(quantity.unit, 0)
        if key != "tendon_stiffness" and power:
            changes[key] = value * s**power
    comparison = tn.similarity.compare(any_inst, any_inst.replace(**changes))
    assert all(group.matches for group in comparison.groups)
    assert comparison.force_factor() == pytest.approx(s**2, rel=1e-12)
    assert comparison.errors["scaled"].largest < 1e-6
    assert comparison.errors["as used"].largest < 1e-6


def test_instruments_of_different_mechanisms_are_refused(real: TendonGear, pulley: Instrument) -> None:
    with pytest.raises(ValueError, match="prototype has joint_type tendon-pulley, model tendon-gear"):
        tn.similarity.compare(real, pulley)
    with pytest.raises(ValueError, match="largest_force is -1"):
        tn.similarity.compare(real, real, largest_force=-1)
