"""The text of a new instrument file: every key with its unit and meaning, a sketch, and what is assumed."""

import json
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from pydantic import BaseModel

from tenodesis.instrument.mechanisms import JOINT_TYPES
from tenodesis.instrument.short_form import ShortForm
from tenodesis.units import Quantity, quantity_of, unit_in

ASSUMED = "assumed"
"""What the source of every value begins with that nobody gave."""


class Question(NamedTuple):
    """A value that is asked for: its option, its key in the file, and the answer that is offered."""

    option: str
    key: str
    default: str


class RopeModulus(NamedTuple):
    """Young's modulus of a kind of rope over its full circle, with its source."""

    modulus: str
    source: str


# 54.2 GPa of a rope of 7x19 wires, over the 190 GPa of the wire, is what stranding leaves.
ROPES = {
    "steel": RopeModulus("54.2 GPa", "7x19 stainless rope, Loos & Company"),
    "steel-7x7": RopeModulus("73.2 GPa", "7x7 stainless rope, Loos & Company"),
    "steel-wire": RopeModulus("190 GPa", "a single wire of stainless steel"),
    "tungsten": RopeModulus("114 GPa", "7x19 rope: the 400 GPa of the wire times what stranding leaves of steel's"),
    "dyneema": RopeModulus("30 GPa", "braided and bedded in; braids differ by a factor of three: measure yours"),
}
"""The ropes that are known by name."""


class RodModulus(NamedTuple):
    """Young's modulus of a backbone's rod, Pa, with its source."""

    modulus: float
    source: str


RODS = {
    "nitinol": RodModulus(60e9, "superelastic NiTi as austenite, of which suppliers give 40 to 80 GPa: measure yours"),
    "steel": RodModulus(206e9, "spring steel, EN 10270-1"),
    "stainless": RodModulus(185e9, "stainless spring steel, EN 10270-3"),
}
"""What a backbone's rod may be of, by name."""

_LENGTHS = (Question("end-effector-length", "end_effector_length", "25 mm"),)
_REST = (
    Question("overall-length", "overall_length", "500 mm"),
    Question("tendon-diameter", "tendon_diameter", "0.63 mm"),
    Question("pretension", "pretension", "30 N"),
)
QUESTIONS: Mapping[str, tuple[Question, ...]] = {
    "tendon-gear": (
        Question("distal-radius", "distal_gear_radius", "2 mm"),
        Question("proximal-radius", "proximal_gear_radius", "4.5 mm"),
        *_LENGTHS,
        *_REST,
    ),
    "tendon-pulley": (
        Question("distal-radius", "distal_pulley_radius", "2 mm"),
        Question("proximal-radius", "proximal_pulley_radius", "4.5 mm"),
        *_LENGTHS,
        *_REST,
    ),
    "continuum": (
        Question("distal-radius", "distal_tendon_offset", "2 mm"),
        Question("proximal-radius", "proximal_pulley_radius", "4.5 mm"),
        Question("backbone-length", "backbone_length", "20 mm"),
        Question("backbone-rigidity", "backbone_rigidity", "200 N*mm^2"),
        *(Question(one.option, one.key, "10 mm") for one in _LENGTHS),
        *(one._replace(default="0.4 mm") if one.key == "tendon_diameter" else one for one in _REST),
    ),
}
"""What is asked for, by joint type."""

_ENDS = {
    "tendon-gear": ("( R )( R )", "( r )( r )"),
    "tendon-pulley": ("( R )", "( r )"),
    "continuum": ("( R )", "[~~ l_b ~~]"),
}
_HEADINGS = {
    "": "Dimensions",
    "conditions": "Loads of figures and tables",
    "friction": "Friction where a tendon bends; `tenodesis identify` finds it from a recording",
    "dynamics": "Inertia of the tip",
    "drives": "Motors that give the lost angle back",
    "sensors": "Load cells at the spools; further keys have noise, bits and sampling rate",
}
_WIDTH = 42


def text(name: str, joint_type: str, values: Mapping[str, str | tuple[str, ...]], sources: Mapping[str, str]) -> str:
    """Return the text of a new instrument file.

    Parameters
    ----------
    name
        Name of the instrument.
    joint_type
        Its joint type.
    values
        Values as text with units by key, within a table with a dot.
    sources
        Source of each value, by key.
    """
    kind = JOINT_TYPES[joint_type]
    lines = [*_introduction(name, joint_type), "", *_header(name, joint_type)]
    tables: dict[str, dict[str, str | tuple[str, ...]]] = {"": {}}
    for key, value in values.items():
        table, _, inner = key.rpartition(".")
        tables.setdefault(table, {})[inner] = value
    for table, held in tables.items():
        lines += ["", f"# {_HEADINGS[table]}.", *([f"[{table}]"] if table else [])]
        lines += [_line(key, value, *_field(kind, table, key)) for key, value in held.items()]
    lines += ["", "# Where each value comes from; correct what is assumed.", "[sources]"]
    lines += [f"{json.dumps(key) if '.' in key else key} = {_quoted(source)}" for key, source in sources.items()]
    return "\n".join(lines) + "\n"


def _introduction(name: str, joint_type: str) -> Iterator[str]:
    yield f"# {name}: an instrument with {joint_type} joints, written by `tenodesis new`."
    yield "#"
    yield "# A value is a number with its unit; any unit of the same kind will do. [sources] says what was assumed. All"
    yield "# keys: the page of that name in the documentation, and `tenodesis schema`. Change a value's source with the"
    yield "# value. What to do next:"
    yield "#"
    yield "#   tenodesis check FILE    prints all values, and warns of implausible ones"
    yield "#   tenodesis loss FILE     says what a load takes, and what gives it back"
    yield "#"
    for line in sketch(joint_type).splitlines():
        yield f"#   {line}".rstrip()


def sketch(joint_type: str) -> str:
    """Return the dimensions of a joint type's instrument as a sketch of letters, at most 76 wide."""
    proximal, distal = _ENDS[joint_type]
    stem = "-" * (48 - len(proximal) - len(distal))
    line = f"o======={proximal}{stem}{distal}=======o"
    rows = [
        "hand".ljust(len(line) - 5) + "force",
        "|".ljust(len(line) - 1) + "|",
        line,
        f"|- l_p -|{'stem'.center(len(line) - 18)}|- l_d -|",
        "|" + " overall length ".center(len(line) - 2, "-") + "|",
        "",
    ]
    letters = {"R": _key(joint_type, "proximal"), "r": _key(joint_type, "distal")}
    letters |= {"l_p": "handle_length", "l_d": "end_effector_length"}
    if joint_type == "continuum":
        letters["l_b"] = "backbone_length"
    return "\n".join([*rows, *(f"{letter:<4} {key}" for letter, key in letters.items())])


def _key(joint_type: str, end: str) -> str:
    fields = JOINT_TYPES[joint_type].parameter_fields
    return next(field for field, parameter in fields.items() if parameter == f"{end}_radius")


def _header(name: str, joint_type: str) -> Iterator[str]:
    yield _line("name", name, _description(ShortForm, "name"), None)
    meaning = f"Mechanism of the joints: {', '.join(JOINT_TYPES)}"
    yield _line("joint_type", joint_type, meaning, None)
    yield _line("axes", ("yaw",), _description(ShortForm, "axes"), None)


def _description(kind: type[BaseModel], key: str) -> str:
    return str(kind.model_fields[key].description)


def _field(kind: type[ShortForm], table: str, key: str) -> tuple[str, Quantity | None]:
    """Return what a key means and its kind of quantity."""
    model: type[BaseModel] = kind
    if table:
        model = type(kind.model_fields[table].default)
    field = next(field for name, field in model.model_fields.items() if key in (name, field.alias))
    return str(field.description), quantity_of(field)


def _line(key: str, value: str | tuple[str, ...], meaning: str, quantity: Quantity | None) -> str:
    written = f"[{', '.join(map(_quoted, value))}]" if isinstance(value, tuple) else _quoted(value)
    if quantity is None and isinstance(value, str) and value.replace(".", "", 1).isdigit():
        written = value
    unit = "" if quantity is None else f"[{unit_in(value if isinstance(value, str) else value[0])}] "
    return f"{f'{key} = {written}':<{_WIDTH}}  # {unit}{meaning}"


def _quoted(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)
