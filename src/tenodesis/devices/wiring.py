"""What the drives and sensors of a bench serve: an instrument's axes, or its joints and tendons by their names."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from tenodesis.control.pairs import names_of
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.instrument.devices import CanOpen, NiDaq
from tenodesis.run import TENDONS, Array, Names

_COLUMNS = ("handle angle", *(f"{side} tension" for side in TENDONS), "output angle")
"""What the sensors of an axis measure."""


class Plug(NamedTuple):
    """A drive or a sensor: what it serves in words, and its place."""

    name: str
    of: str
    """The axis, joint or tendon."""
    place: int
    """Of a drive the number of its tendon; of a sensor that among the handle's angles, then the tensions, then the
    output angles."""
    part: Any
    """Its table."""


class Wiring(NamedTuple):
    """All drives and sensors of a bench."""

    names: Names
    drives: tuple[Plug, ...]
    sensors: tuple[Plug, ...]
    tendons: tuple[str, ...]
    """Tendons, where they are wired by name; empty where by axis."""

    @property
    def distal(self) -> bool:
        """Whether every joint has an encoder at the tip."""
        first = len(self.names.handle_joints) + len(self.names.tendons)
        return sum(plug.place >= first for plug in self.sensors) == len(self.names.joints)

    @property
    def spools(self) -> tuple[int, ...]:
        """Shape of what there is per spool."""
        return (len(self.tendons),) if self.tendons else (len(self.names.joints), 2)

    def split(self, values: Array) -> tuple[Array, Array, Array]:
        """Return handle angles, tensions in the shape of the spools, and output angles, from values by place."""
        handles = len(self.names.handle_joints)
        tensions = handles + len(self.names.tendons)
        return values[:handles], values[handles:tensions].reshape(self.spools), values[tensions:]


def wiring(inst: Instrument, settings: CanOpen | NiDaq, key: str, current_of: Callable[[Any, float], Any]) -> Wiring:
    """Return how a bench of an instrument is wired by its table under a key of ``devices``.

    `current_of` gives a drive's current as the source of a tension, of which 1 A stands for so many N.

    Raises
    ------
    InstrumentError
        A tendon, a joint or an axis is missing, or one is named that the instrument does not have.
    """
    short = inst.short_form
    names, drives, sensors = _by_name(inst, settings, key) if short is None else _by_axis(short, settings, key)
    if inst.sensors.kind == "current":
        first = len(names.handle_joints)
        sensors |= {
            first + drive.place: Plug(
                "tension" if short is None else f"{TENDONS[drive.place % 2]} tension",
                drive.of,
                first + drive.place,
                current_of(drive.part, sensor.per_current),
            )
            for drive, sensor in ((drive, inst.tension_sensors[drive.place]) for drive in drives)
        }
    # Axis after axis, or by what is measured.
    order = [(0 if short is None else short.axes.index(plug.of), place) for place, plug in sensors.items()]
    return Wiring(names, drives, tuple(sensors[place] for _, place in sorted(order)), names.tendons * (short is None))


_Found: TypeAlias = tuple[Names, tuple[Plug, ...], dict[int, Plug]]
"""Names, drives, and sensors by place."""


def _by_axis(inst: ShortForm, settings: CanOpen | NiDaq, key: str) -> _Found:
    names, count = names_of(inst), len(inst.axes)
    drives: list[Plug] = []
    sensors: dict[int, Plug] = {}
    for n, name in enumerate(inst.axes):
        axis = getattr(settings, name)
        if axis is None:
            raise InstrumentError(
                f"devices.{key}.{name} is missing; {inst.name} has that axis.",
                key=f"devices.{key}.{name}",
                allowed="given",
            )
        drives += [
            Plug(f"the {side} drive of {name}", name, 2 * n + m, drive)
            for m, (side, drive) in enumerate(zip(TENDONS, axis.drives, strict=True))
        ]
        places = dict(zip(_COLUMNS, (n, count + 2 * n, count + 2 * n + 1, 3 * count + n), strict=True))
        sensors |= {places[what]: Plug(what, name, places[what], source) for what, source in axis.sources.items()}
    return names, tuple(drives), sensors


def _by_name(inst: Instrument, settings: CanOpen | NiDaq, key: str) -> _Found:
    names = names_of(inst)
    wound = [tendon.name for tendon in inst.tendons if tendon.start == "spool"]
    groups = {
        "tendons": (settings.tendons, wound, names.tendons),
        "handle_joints": (settings.handle_joints, names.handle_joints, names.handle_joints),
        "joints": (settings.joints, (), names.joints),
    }
    for group, (given, needed, there) in groups.items():
        missing = next((name for name in needed if name not in given), None)
        if missing is not None:
            raise InstrumentError(
                f"devices.{key}.{group}.{missing} is missing; {inst.name} has it.",
                key=f"devices.{key}.{group}.{missing}",
                allowed="given",
            )
        unknown = next((name for name in given if name not in there), None)
        if unknown is not None:
            allowed = ", ".join(there) or "left out"
            raise InstrumentError(key=f"devices.{key}.{group}", value=unknown, allowed=f"among {allowed}")
    drives = [
        Plug(f"the drive of {name}", name, names.tendons.index(name), part) for name, part in settings.tendons.items()
    ]
    cells = {name: one.tension for name, one in settings.tendons.items() if one.tension is not None}
    measured = (
        ("handle angle", names.handle_joints, settings.handle_joints),
        ("tension", names.tendons, cells),
        ("output angle", names.joints, settings.joints),
    )
    sensors: dict[int, Plug] = {}
    first = 0
    for what, there, wired in measured:
        sensors |= {
            first + n: Plug(what, name, first + n, wired[name]) for n, name in enumerate(there) if name in wired
        }
        first += len(there)
    return names, tuple(sorted(drives, key=lambda plug: plug.place)), sensors
