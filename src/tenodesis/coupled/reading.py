"""Files of coupled instruments, and planar instruments as coupled ones."""

from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError

from tenodesis import plant
from tenodesis.coupled.description import ENTRIES, CoupledInstrument, RouteError
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument, InstrumentLike, as_instrument
from tenodesis.instrument.hardware import Hand
from tenodesis.kinematics import dimensions
from tenodesis.toml import parse_toml, read_text, validated

CoupledLike: TypeAlias = CoupledInstrument | Instrument | str | Path
"""A coupled instrument, a planar one, the name of a coupled one that comes with the package, or the path of a file."""

_MECHANISMS = {"tendon-gear": "tendon-gear", "tendon-pulley": "pulley", "continuum": "continuum"}


def shipped() -> tuple[str, ...]:
    """Return the names of the coupled instruments that come with the package."""
    return tuple(sorted(Path(entry.name).stem for entry in _folder().iterdir() if entry.name.endswith(".toml")))


def load(name_or_path: CoupledLike) -> CoupledInstrument:
    """Read a coupled instrument that comes with the package, by name, or a file that lists joints and tendons, by path.

    A coupled instrument is returned as it is, a planar one by :func:`of_planar`. Raises InstrumentError if there is no
    such instrument or file, it cannot be read, or it is not valid.
    """
    if isinstance(name_or_path, CoupledInstrument):
        return name_or_path
    if isinstance(name_or_path, Instrument):
        return of_planar(name_or_path)
    if not isinstance(name_or_path, str | Path):
        raise TypeError(f"inst is {name_or_path!r}; it must be an instrument, its name or the path of its file.")
    source = str(name_or_path)
    if source in shipped():
        return _shipped(source)
    text = read_text(Path(name_or_path), InstrumentError, source=source, kind="coupled instrument", names=shipped())
    return parse(text, source)


def parse(text: str, source: str = "instrument") -> CoupledInstrument:
    """Read a coupled instrument from the text (str) of its file.

    Raises InstrumentError, whose message starts with `source`, if the text is not TOML or not a valid instrument.
    """
    values = parse_toml(text, InstrumentError, source, "a coupled instrument")
    return validated(CoupledInstrument, values, InstrumentError, source, context={"file": True}, entries=ENTRIES)


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of coupled instruments' files, for editors that complete and check TOML."""
    schema = CoupledInstrument.model_json_schema()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": "Tenodesis coupled instrument",
    }


def is_coupled(name_or_path: str | Path) -> bool:
    """Return whether this is the name of a shipped coupled instrument, or a file that lists joints and tendons."""
    if str(name_or_path) in shipped():
        return True
    try:
        values = parse_toml(read_text(Path(name_or_path), InstrumentError), InstrumentError, str(name_or_path))
    except InstrumentError:
        return False
    return "joint_type" not in values and not {"joints", "tendons"}.isdisjoint(values)


def misrouted(name_or_path: str | Path) -> RouteError | None:
    """Return what is wrong with the routes in a file that :func:`load` refuses, with what its tables describe.

    None if something else is wrong.
    """
    values = parse_toml(read_text(Path(name_or_path), InstrumentError), InstrumentError, str(name_or_path))
    try:
        CoupledInstrument.model_validate(values, context={"file": True})
    except ValidationError as invalid:
        problem = invalid.errors(include_url=False)[0].get("ctx", {}).get("error")
        return problem if isinstance(problem, RouteError) else None
    return None


def of_planar(inst: InstrumentLike) -> CoupledInstrument:
    """Return an instrument of one or two planar axes as joints and tendons: what its file is short for.

    Tendons of the second axis pass the first joint in its middle plane, at the tip as at the handle. The table mismatch
    is left out: it is not of the instrument, but of a bench. Raises InstrumentError for friction that coupled
    instruments do not have.
    """
    inst = as_instrument(inst)
    lengths = dimensions(inst)
    joints: list[dict[str, Any]] = []
    for place, radii in (("handle", lengths.proximal_radii), ("tip", lengths.distal_radii)):
        for i, (axis, planar) in enumerate(zip(inst.axes, inst.planar, strict=True)):
            at_tip, is_last = place == "tip", i == len(inst.axes) - 1
            mechanism = _MECHANISMS[inst.joint_type]
            joint = {
                "name": axis if at_tip else f"handle_{axis}",
                "place": place,
                "mechanism": "pulley" if mechanism == "continuum" and not at_tip else mechanism,
                "axis": axis,
                "radius": radii[i],
                "range": planar.output_range if at_tip else planar.handle_range,
                "offset": 0.0 if i == 0 else lengths.joint_spacing if at_tip else lengths.handle_joint_spacing,
            }
            if joint["mechanism"] == "continuum":
                joint |= {"backbone_length": planar.backbone_length, "backbone_rigidity": planar.backbone_rigidity}
            if at_tip:
                motion = plant.parameters(planar)
                joint |= {
                    "inertia": motion["tip_inertia"],
                    "damping": motion["tip_damping"],
                    "stop": planar.output_stop,
                }
            if is_last:
                joint["end_effector_length"] = lengths.end_effector_length if at_tip else lengths.handle_length
            joints.append(joint)
    tendons = []
    for i, (axis, planar) in enumerate(zip(inst.axes, inst.planar, strict=True)):
        for side in ("agonist", "antagonist"):
            passed = [{"joint": f"handle_{other}", "side": "middle"} for other in reversed(inst.axes[:i])]
            beyond = [{"joint": other, "side": "middle"} for other in inst.axes[:i]]
            # A handle's tendon starts at its own joint and passes those that stand nearer to the stem.
            route = [{"joint": f"handle_{axis}", "side": side}, *passed, *beyond, {"joint": axis, "side": side}]
            wrapped = [crossing | {"base_wrap": inst.friction.base_wrap} for crossing in route]
            tendon = {"name": f"{axis}_{side}", "route": wrapped, "stiffness": planar.tendon_stiffness}
            tendons.append(tendon | {"pretension": planar.pretension})
    values = {
        "name": inst.name,
        "description": inst.description,
        "stem_length": lengths.stem_length,
        "stem_diameter": lengths.stem_diameter,
        "pretension": inst.pretension,
        "joints": joints,
        "tendons": tendons,
    }
    values |= {
        table: getattr(inst, table).model_dump(exclude_unset=True, exclude_none=True)
        for table in ("drives", "sensors", "control")
    }
    values["dynamics"] = {name: getattr(inst.dynamics, name) for name in Hand.model_fields}
    shares = plant.compliance_shares(inst.planar[0])
    values["friction"] = inst.friction.model_dump(exclude_none=True) | {
        "base_wrap": 0.0,
        "handle_compliance_share": shares.handle,
        "handle_joint_compliance_share": shares.handle_joint,
        "tip_joint_compliance_share": shares.tip_joint,
    }
    if inst.breaking_load is not None:
        values["breaking_load"] = inst.breaking_load
    return validated(CoupledInstrument, values, InstrumentError, inst.name, entries=ENTRIES)


def _folder() -> Any:
    return resources.files("tenodesis.coupled") / "shipped"


@cache
def _shipped(name: str) -> CoupledInstrument:
    return parse(str((_folder() / f"{name}.toml").read_text("utf-8")), name)
