"""Claims about names and paths in place of instruments."""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument, InstrumentLike
from tenodesis.instrument.text import to_toml

POSTURE = tn.kinematics.Posture(yaw=0.2)
CALLS: dict[str, Callable[[InstrumentLike], Any]] = {
    "statics.output_angle": lambda inst: tn.statics.output_angle(inst, 0.2, 1.0),
    "statics.gradient": lambda inst: tn.statics.gradient("output_angle", inst, 0.2, 1.0, wrt=["force"]),
    "statics.reach": tn.statics.reach,
    "twin.Twin": lambda inst: tn.twin.Twin(inst).run(np.zeros((3, 2)))["output_angle"].tolist(),
    "control.Controller": lambda inst: tn.control.Controller(inst).parameters.common,
    "control.parameters": lambda inst: tn.control.parameters(inst).common,
    "control.header": tn.control.header,
    "control.resolution": tn.control.resolution,
    "kinematics.dimensions": tn.kinematics.dimensions,
    "kinematics.limits": tn.kinematics.limits,
    "kinematics.forward": lambda inst: tn.kinematics.forward(inst, POSTURE).position.tolist(),
    "kinematics.jacobian": lambda inst: tn.kinematics.jacobian(inst, POSTURE).tolist(),
    "kinematics.within_limits": lambda inst: tn.kinematics.within_limits(inst, POSTURE),
    "kinematics.joint_positions": lambda inst: tn.kinematics.joint_positions(inst, POSTURE),
    "kinematics.mjcf": tn.kinematics.mjcf,
    "kinematics.urdf": tn.kinematics.urdf,
    "kinematics.workspace": lambda inst: tn.kinematics.workspace(inst, points=5).span.tolist(),
    "similarity.compare": lambda inst: tn.similarity.compare(inst, "scaled-up").force_factor(),
    "similarity.compare, scaled_up": lambda inst: tn.similarity.compare("scaled-up", inst).force_factor(),
    "simulate.Protocol.duration": lambda inst: tn.simulate.load("cycles").duration(inst),
    "simulate.Protocol.commands": lambda inst: tn.simulate.load("cycles").commands(inst, 0.01)["force"].tolist(),
    "scaling.name_of": tn.scaling.name_of,
    "tolerance.default": tn.tolerance.default,
}
PACKAGES = [name for name in tn.__all__ if isinstance(getattr(tn, name), ModuleType)]


@pytest.mark.parametrize("name", CALLS)
def test_a_name_or_a_path_is_as_good_as_the_instrument(name: str, real: Instrument, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(to_toml(real), "utf-8")
    call = CALLS[name]
    of_instrument = call(real)
    assert call("real-size") == of_instrument
    assert call(file) == of_instrument
    assert call(str(file)) == of_instrument


def test_many_twins_of_names_and_paths_are_those_of_the_instruments(scaled: Instrument, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(to_toml(scaled), "utf-8")
    handle = np.linspace(0, 0.1, 50)
    expected = tn.twin.run_many([scaled, scaled], handle)["output_angle"]
    assert (tn.twin.run_many(["scaled-up", file], handle)["output_angle"] == expected).all()
    assert (tn.twin.run_many("scaled-up", handle)["output_angle"] == expected[:1]).all()


def test_loading_an_instrument_returns_it(real: Instrument) -> None:
    assert tn.load(real) is real
    assert tn.load("real-size") is tn.load("real-size")


def test_a_file_that_has_changed_is_read_again(real: Instrument, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    for pretension in (20.0, 30.0):
        file.write_text(to_toml(real.replace(pretension=pretension)), "utf-8")
        assert tn.statics.tensions(file, 0.0).agonist == pytest.approx(pretension)


def _public_functions() -> Iterator[tuple[str, Callable[..., Any]]]:
    for package in PACKAGES:
        module = import_module(f"tenodesis.{package}")
        for name in module.__all__:
            found = getattr(module, name)
            if inspect.isfunction(found) or (
                inspect.isclass(found) and not is_dataclass(found) and "__init__" in vars(found)
            ):
                yield f"{package}.{name}", found


def test_no_public_function_requires_an_instrument_that_was_loaded_before() -> None:
    required = [
        f"{name}({parameter.name})"
        for name, function in _public_functions()
        for parameter in inspect.signature(function).parameters.values()
        if parameter.annotation in (Instrument, "Instrument")
    ]
    assert not required
