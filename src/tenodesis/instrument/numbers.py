"""Values of an instrument by their keys in its file, as :meth:`tenodesis.instrument.Instrument.replace` takes them."""

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tenodesis.instrument.full_form import FullForm
from tenodesis.instrument.instrument import Instrument


def values_by_key(inst: Instrument) -> dict[str, tuple[Any, FieldInfo]]:
    """Return every value with its field: friction.KEY, joints.NAME.KEY, tendons.NAME.KEY and tendons.NAME.JOINT.KEY.

    A tendon's stiffness, its pretension and its radius at a joint are those that it has by default, too.
    """
    return dict(_values(inst))


def _values(table: BaseModel, prefix: str = "") -> Iterator[tuple[str, tuple[Any, FieldInfo]]]:
    for name, field in type(table).model_fields.items():
        value = table.as_given(name) if isinstance(table, Instrument) else getattr(table, name)
        key = prefix + (field.alias or name)
        if isinstance(value, BaseModel):
            yield from _values(value, f"{key}.")
        elif isinstance(value, tuple) and isinstance(table, FullForm):
            for n, one in enumerate(value):
                if isinstance(one, BaseModel):
                    yield from _of_entry(table, key, n, one)
        yield key, (value, field)


def _of_entry(inst: FullForm, key: str, place: int, entry: BaseModel) -> Iterator[tuple[str, tuple[Any, FieldInfo]]]:
    own = f"{key}.{getattr(entry, 'name', place)}"
    used = {} if key != "tendons" else {"stiffness": inst.stiffnesses[place], "pretension": inst.pretensions[place]}
    for name, (value, field) in _values(entry, f"{own}."):
        yield name, (float(used[one]) if (one := name.rpartition(".")[2]) in used else value, field)
    for crossing in getattr(entry, "route", ()):
        joint = next(one for one in inst.as_given("joints") if one.name == crossing.joint)
        for name, (value, field) in _values(crossing, f"{own}.{crossing.joint}."):
            yield name, (joint.radius if name.endswith(".radius") and value is None else value, field)
