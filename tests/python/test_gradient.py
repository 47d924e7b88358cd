"""Claims about derivatives: each against central finite differences."""

from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument

CASES: list[tuple[str, dict[str, Any]]] = [
    ("output_angle", {"handle_angle": 0.35, "force": 0.9, "radial_force": 2.0, "wound": (2e-4, -1e-4)}),
    ("output_angle", {"handle_angle": 0.35, "force": 5.9}),  # antagonist slack; gears take less, see below
    ("handle_angle", {"output_angle": 0.6, "force": 0.9, "radial_force": 2.0, "wound": (2e-4, -1e-4)}),
    ("tensions", {"handle_angle": 0.35, "force": 0.9}),
    ("torque_transmissibility", {"handle_angle": 0.35, "force": 0.9}),
    ("flexural_stiffness", {"output_angle": 0.6}),
    ("loss_of_dexterity", {"output_angle": 0.6, "force": 0.9}),
    ("slack_force", {"output_angle": 0.6}),
    ("estimate_output_angle", {"handle_angle": 0.35, "agonist": 38.0, "antagonist": 21.0, "wound": (1e-4, 0.0)}),
    ("estimate_output_angle", {"handle_angle": 0.35, "agonist": 75.0, "antagonist": 0.2, "slack_below": 1.0}),
    ("compensation_stroke", {"agonist": 38.0, "antagonist": 21.0, "actuation": "agonist"}),
    ("compensation_stroke", {"agonist": 90.0, "antagonist": 0.0, "actuation": "differential"}),
]


def call(name: str, inst: Instrument, arguments: dict[str, Any]) -> np.ndarray:
    return np.atleast_1d(np.array(getattr(tn.statics, name)(inst, **arguments)))


def changed(arguments: dict[str, Any], key: str, step: float) -> dict[str, Any]:
    if key.endswith("_wound"):
        first, second = arguments.get("wound", (0.0, 0.0))
        wound = (first + step, second) if key == "agonist_wound" else (first, second + step)
        return arguments | {"wound": wound}
    return arguments | {key: arguments.get(key, 0.0) + step}


@pytest.mark.parametrize(("name", "arguments"), CASES)
def test_derivatives_by_everything_match_finite_differences(
    any_inst: Instrument, name: str, arguments: dict[str, Any]
) -> None:
    inst = any_inst
    if name == "output_angle" and arguments["force"] == 5.9 and inst.joint_type == "tendon-gear":
        arguments = arguments | {"force": 1.2 * tn.statics.slack_force(inst, 0.0)}
    fields = [
        key
        for key in inst.parameter_fields
        if key not in ("given_stiffness", "tendon_length") and getattr(inst, key) is not None
    ] + ["overall_length"]
    inputs = [key for key in ("handle_angle", "output_angle", "force", "agonist", "antagonist") if key in arguments]
    if "wound" in arguments:
        inputs += ["agonist_wound", "antagonist_wound"]
    exact = tn.statics.gradient(name, inst, wrt=[*fields, *inputs], **arguments)
    base = call(name, inst, arguments)
    for key in [*fields, *inputs]:
        scale = getattr(inst, key) if key in fields else {"agonist_wound": 1e-3, "antagonist_wound": 1e-3}.get(key, 1.0)

        def shifted(share: float, key: str = key, scale: float = scale) -> np.ndarray:
            step = share * scale
            if key in fields:
                return call(name, inst.replace(**{key: getattr(inst, key) + step}), arguments)
            return call(name, inst, changed(arguments, key, step))

        h = 1e-3
        # Fourth order, so that neither truncation nor rounding reaches the bound.
        numeric = (8 * (shifted(h) - shifted(-h)) - (shifted(2 * h) - shifted(-2 * h))) / (12 * h * scale)
        found = np.atleast_1d(np.array(exact[key]))
        floor = 1e-7 * np.abs(base).max() / scale
        assert np.abs(found - numeric).max() <= 1e-6 * np.abs(numeric).max() + floor, key


def test_a_given_stiffness_is_a_parameter_and_a_derived_one_is_not(real: Instrument) -> None:
    given = real.replace(tendon_stiffness="31 N/mm")
    by_k = tn.statics.gradient("output_angle", given, 0.3, 1.0, wrt=["tendon_stiffness"])["tendon_stiffness"]
    assert by_k > 0
    with pytest.raises(ValueError, match="follows from modulus"):
        tn.statics.gradient("output_angle", real, 0.3, 1.0, wrt=["tendon_stiffness"])
    with pytest.raises(ValueError, match="'tendon_modulus'"):
        tn.statics.gradient("output_angle", given, 0.3, 1.0, wrt=["tendon_modulus"])


def test_many_directions_at_once_equal_one_at_a_time(real: Instrument) -> None:
    keys = ["pretension", "tendon_modulus", "distal_gear_radius", "proximal_gear_radius", "force", "handle_angle"]
    handle = np.linspace(-0.3, 0.5, 700)
    together = tn.statics.gradient(tn.statics.tensions, real, handle, 2.2, wrt=keys)
    for key in keys:
        alone = tn.statics.gradient(tn.statics.tensions, real, handle, 2.2, wrt=[key])[key]
        assert np.array_equal(np.array(alone), np.array(together[key]), equal_nan=True)
