"""Tables of every key of every file, from the models that read the files."""

import inspect
import math
import re
from collections.abc import Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tenodesis.instrument import JOINT_TYPES, FullForm, Instrument, ShortForm
from tenodesis.scaling.catalogue import CatalogueFile
from tenodesis.simulate.protocol import Protocol
from tenodesis.tolerance.files import Tolerances
from tenodesis.units import READABLE, Quantity, in_unit, quantity_of

_HEADER = "| key | unit | default | allowed | meaning |\n|---|---|---|---|---|"
_IN_FILES = READABLE | {"N*m*s": "N*m*s", "rad/s^2": "rad/s^2"}


def tables(of: str) -> str:
    """Return the tables of a kind of file: "instrument", "protocol", "catalogue" or "tolerances"."""
    files = {"protocol": Protocol, "catalogue": CatalogueFile, "tolerances": Tolerances}
    return "\n".join(_instrument() if of == "instrument" else _sections(files[of]))


def key(name: str, field: FieldInfo) -> str:
    """Return a field's key in the file."""
    return field.alias or name


def _instrument() -> Iterator[str]:
    yield f"### Every instrument\n\n{_HEADER}"
    yield from (_row(name, field) for name, field in Instrument.model_fields.items())
    yield f"\n### The short form\n\n{_HEADER}"
    kinds = " or ".join(f'`"{name}"`' for name in JOINT_TYPES)
    yield f"| `joint_type` | text | *required* | {kinds} | Mechanism of the joints |"
    yield from (_row(name, field) for name, field in _own(ShortForm, Instrument).items() if name != "joint_type")
    for name, kind in JOINT_TYPES.items():
        yield f'\n### `joint_type = "{name}"`\n\n{_sentence(kind)}\n\n{_HEADER}'
        yield from (_row(key, field) for key, field in _own(kind, ShortForm).items())
    yield f"\n### Joints and tendons\n\n{_HEADER}"
    yield from (_row(name, field) for name, field in _own(FullForm, Instrument).items())
    yield ""
    yield from _tables_of(ShortForm, FullForm)


def _own(kind: type[BaseModel], base: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields that a model has beside those of its base."""
    return {name: field for name, field in kind.model_fields.items() if name not in base.model_fields}


def _sections(kind: type[BaseModel]) -> Iterator[str]:
    yield f"### Keys of the {kind.__name__.removesuffix('File').lower()}\n\n{_HEADER}"
    yield from (_row(name, field) for name, field in kind.model_fields.items())
    yield ""
    yield from _tables_of(kind)


def _tables_of(*kinds: type[BaseModel]) -> Iterator[str]:
    """Yield a section for each table below models, where tables of the same kind stand in one."""
    places: dict[type[BaseModel], list[str]] = {}
    for place, table in (found for kind in kinds for found in _places(kind)):
        places.setdefault(table, []).append(re.sub(r"\.(yaw|pitch)\b", ".AXIS", place))
    for table, names in places.items():
        yield f"### {', '.join(dict.fromkeys(names))}\n\n{_sentence(table)}\n\n{_HEADER}"
        tag = _tag(table)
        yield from (_row(name, field) for name, field in table.model_fields.items() if field is not tag)
        yield ""


def _places(kind: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    for name, field in kind.model_fields.items():
        path = prefix + key(name, field) + (".NAME" if get_origin(_bare(field.annotation)) is Mapping else "")
        several = get_origin(_bare(field.annotation)) in (tuple, list)
        for table in _tables(field.annotation):
            tag = _tag(table)
            suffix = f', `kind = "{tag.default}"`' if tag else (" (series)" if _is_series(table) else "")
            yield (f"`[[{path}]]`" if several else f"`[{path}]`") + suffix, table
            yield from _places(table, f"{path}.")


def _tag(table: type[BaseModel]) -> FieldInfo | None:
    """Return the key that distinguishes a table from others in its place, if it has one."""
    kind = table.model_fields.get("kind")
    return kind if kind is not None and len(get_args(kind.annotation)) == 1 else None


def _is_series(table: type[BaseModel]) -> bool:
    return table.__name__.endswith("Series")


def _below(kind: type[BaseModel]) -> Iterator[type[BaseModel]]:
    yield kind
    for field in kind.model_fields.values():
        for table in _tables(field.annotation):
            yield from _below(table)


def _tables(annotation: Any) -> list[type[BaseModel]]:
    """Return the tables among the types that an annotation is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for option in get_args(annotation) for table in _tables(option)]


def _row(name: str, field: FieldInfo) -> str:
    cells = (
        f"`{key(name, field)}`",
        _unit(field),
        _default(field),
        _allowed(field),
        field.description or _about(field),
    )
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _about(field: FieldInfo) -> str:
    return "; ".join(_sentence(table).rstrip(".") for table in _tables(field.annotation))


def _unit(field: FieldInfo) -> str:
    quantity = quantity_of(field)
    if quantity is None:
        return _kind(field.annotation)
    several = "list of " if _several(field.annotation) else ""
    several = "table of " if get_origin(_bare(field.annotation)) is Mapping else several
    return f'{several}{quantity.name}, `"{quantity.example}"`'


def _kind(annotation: Any) -> str:
    """Return what is written for a value that has no unit."""
    inner = _bare(annotation)
    if _tables(inner):
        return "tables" if _several(inner) else "table"
    if get_origin(inner) in (UnionType, Union):
        return " or ".join(dict.fromkeys(_kind(option) for option in get_args(inner)))
    if get_origin(inner) in (tuple, list):
        kinds = dict.fromkeys(_kind(option) for option in get_args(inner) if option is not Ellipsis)
        return f"list of {'s or '.join(kinds)}s".replace("texts", "text")
    if get_origin(inner) is Literal:
        return "text"
    named = {bool: "true or false", int: "whole number", float: "number"}
    return next((text for kind, text in named.items() if inner is kind), "text" if inspect.isclass(inner) else "table")


def _bare(annotation: Any) -> Any:
    """Return an annotation without None and without what is annotated."""
    if get_origin(annotation) is Annotated:
        return _bare(get_args(annotation)[0])
    if get_origin(annotation) in (UnionType, Union):
        options = [option for option in get_args(annotation) if option is not type(None)]
        return _bare(options[0]) if len(options) == 1 else annotation
    return annotation


def _several(annotation: Any) -> bool:
    return get_origin(_bare(annotation)) in (tuple, list)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "*required*"
    value = field.default
    if value is None or isinstance(value, BaseModel) or value in ((), {}, ""):
        return "–"
    return f"`{_shown(value, quantity_of(field))}`"


def _shown(value: Any, quantity: Quantity | None) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_shown(item, quantity) for item in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if quantity is None:
        return f"{value:g}" if isinstance(value, float) else str(value)
    unit = _IN_FILES.get(quantity.unit, quantity.unit)
    return f'"{value * in_unit(unit, quantity.unit):.4g} {unit}"'


def _allowed(field: FieldInfo) -> str:
    options = [
        option for inner in _parts(field.annotation) if get_origin(inner) is Literal for option in get_args(inner)
    ]
    if options:
        return ", ".join(f'`"{option}"`' for option in options)
    quantity = quantity_of(field)
    bounds = [] if quantity is None else _bounds_of(quantity)
    inner = (note for part in _parts(field.annotation) for note in getattr(part, "__metadata__", ()))
    several = _several(field.annotation)
    for note in (*field.metadata, *inner):
        for limit in (note, *getattr(note, "metadata", ())):
            bounds += _bound(limit, quantity, "values" if several else "characters")
    return ", ".join(dict.fromkeys(bounds))


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield an annotation and all that it is made of, except for tables."""
    if _tables(annotation) and inspect.isclass(annotation):
        return
    yield annotation
    if get_origin(annotation) is not Literal:
        for option in get_args(annotation):
            yield from _parts(option)


def _bounds_of(quantity: Quantity) -> list[str]:
    bounds = (("above", quantity.above), ("at least", quantity.at_least), ("below", quantity.below))
    return [f"{word} {_number(bound, quantity)}" for word, bound in bounds if bound is not None]


def _bound(limit: Any, quantity: Quantity | None, of: str) -> list[str]:
    words = {Ge: ("at least", "ge"), Gt: ("above", "gt"), Le: ("at most", "le"), Lt: ("below", "lt")}
    if type(limit) in words:
        word, attribute = words[type(limit)]
        return [f"{word} {_number(getattr(limit, attribute), quantity)}"]
    if isinstance(limit, MaxLen):
        return [f"at most {limit.max_length} {of}"]
    if isinstance(limit, MinLen) and of == "values":
        return [f"at least {limit.min_length} {of}"]
    return []


def _number(bound: float, quantity: Quantity | None) -> str:
    unit = "" if quantity is None else quantity.unit
    if unit == "rad":
        return f"{math.degrees(bound):.5g} deg"
    return f"{bound if isinstance(bound, int) else format(bound, 'g')} {unit.replace('*', '·')}".rstrip()


def _sentence(kind: type) -> str:
    return (inspect.getdoc(kind) or "").split("\n\n")[0].replace("\n", " ")
