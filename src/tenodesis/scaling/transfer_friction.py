"""Transfer friction identified on a scaled-up instrument to the file of the real-size instrument."""

from collections.abc import Mapping
from math import degrees
from typing import TypeVar

from tenodesis.errors import InstrumentError
from tenodesis.instrument import ShortForm
from tenodesis.scaling.transfer_factors import comparison, factors

_T = TypeVar("_T", bound=ShortForm)


def carry_friction(scaled: ShortForm, real_size: _T, *, source: str = "", time_factor: float | None = None) -> _T:
    """Return the real-size instrument with the friction of the scaled-up instrument.

    Coefficients, bends and the arrangement of contacts stay the same, since capstan friction is dimensionless; constant
    friction scales as a tension; viscous friction, the speed and memory of the Stribeck law, the references of a power
    of the tension, vertex radius and bending stiffness scale by their dimensions. Only the table friction and its
    source change; `source` is the file of the scaled-up instrument or recording, named in it. The factor of time is by
    default that of the tips' periods.

    Raises InstrumentError if the scaled-up instrument has no friction, no axis or another joint type in common, or the
    carried friction is not allowed.
    """
    if scaled.friction.law == "none":
        raise InstrumentError(
            f"{scaled.name} has no friction to transfer; its friction.law must not be none.",
            key="friction.law",
            value=scaled.friction.law,
            allowed="a law other than none",
        )
    axis = shared_axes(scaled, real_size)[0]
    scale = factors(comparison(real_size.axis(axis), scaled.axis(axis)), time_factor)
    sources = {key: text for key, text in real_size.sources.items() if key.partition(".")[0] != "friction"}
    sources["friction"] = f"transferred from {scaled.name}" + (f" ({source})" if source else "")
    return real_size.replace(friction=_scaled(scaled, scale), sources=sources)


def shared_axes(scaled: ShortForm, real_size: ShortForm) -> tuple[str, ...]:
    """Return the axes of the scaled-up instrument.

    Raises InstrumentError if the real-size one lacks one of them, or has another joint type.
    """
    if scaled.joint_type != real_size.joint_type:
        raise InstrumentError(
            f"{scaled.name} has joint_type {scaled.joint_type}, {real_size.name} {real_size.joint_type}; "
            "both must have the same.",
            key="joint_type",
            value=scaled.joint_type,
            allowed=real_size.joint_type,
        )
    for axis in scaled.axes:
        real_size.axis(axis)
    return scaled.axes


def left_behind(scaled: ShortForm) -> tuple[str, ...]:
    """Return sentences on entries of the scaled-up instrument's table mismatch that are not transferred."""
    mismatch = scaled.mismatch
    sentences = []
    if mismatch.stiffness_ratio != 1:
        sentences.append(
            f"{scaled.name} has mismatch.stiffness_ratio {mismatch.stiffness_ratio:g}: a property of its ropes, which "
            "is not transferred; the factors are those of its true ropes."
        )
    errors = {
        "handle_encoder_offset": f"{degrees(mismatch.handle_encoder_offset):.3g} deg",
        "output_encoder_offset": f"{degrees(mismatch.output_encoder_offset):.3g} deg",
        "load_cell_gain": f"{mismatch.load_cell_gain[0]:g} and {mismatch.load_cell_gain[1]:g}",
        "load_cell_bias": f"{mismatch.load_cell_bias[0]:g} N and {mismatch.load_cell_bias[1]:g} N",
    }
    defaults = type(mismatch)()
    found = [f"{key} {text}" for key, text in errors.items() if getattr(mismatch, key) != getattr(defaults, key)]
    if found:
        sentences.append(f"{scaled.name} has mismatch.{', '.join(found)}: measured signals are converted as measured.")
    return tuple(sentences)


def _scaled(scaled: ShortForm, scale: Mapping[str, float]) -> dict[str, object]:
    """Return the table friction of the real-size file, without defaults and without keys that its law does not use."""
    friction = scaled.friction
    speed = scale["motor_stroke"] / scale["time"]
    by_dimension = {
        "constant": scale["tension"],
        "reference_tension": scale["tension"],
        "reference_radius": scale["length"],
        "vertex_radius": scale["length"],
        "tendon_bending_stiffness": scale["tension"] * scale["length"] ** 2,
        "viscous": scale["tension"] / speed,
        "stribeck_speed": speed,
        "memory": scale["time"],
    }
    of_law = {"stribeck": {"stribeck_speed", "memory"}, "capstan-power": {"reference_tension", "reference_radius"}}
    given = friction.model_dump(exclude_defaults=True).keys() - of_law["stribeck"]
    given |= of_law.get(friction.law, set())
    values = {key: getattr(friction, key) for key in type(friction).model_fields if key in given}
    return {key: value / by_dimension[key] if key in by_dimension else value for key, value in values.items()}
