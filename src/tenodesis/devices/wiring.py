"""What the drives and sensors of a bench serve: an instrument's axes, or its joints and tendons by their names."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from tenodesis.control.pairs import names_of
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.instrument.devices import CanOpen, NiDaq
from tenodesis.run import TENDONS, Array, Names

COLUMNS = ("handle angle", *(f"{side} tension" for side in TENDONS), "output angle")
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


def wiring(
    inst: Instrument,
    settings: CanOpen | NiDaq,
    key: str,
    sources_of: Callable[[ShortForm, Any], Mapping[str, Any]] = lambda _, axis: axis.sources,
) -> Wiring:
    """Return how a bench of an instrument is wired by its table under a key of ``devices``.

    `sources_of` gives the sensors of an axis, whose instrument is that axis alone, by what they measure.

    Raises
    ------
    InstrumentError
        A tendon, a joint or an axis is missing, or one is named that the instrument does not have.
    """
    short = inst.short_form
    return _by_name(inst, settings, key) if short is None else _by_axis(short, settings, key, sources_of)


def _by_axis(
    inst: ShortForm, settings: CanOpen | NiDaq, key: str, sources_of: Callable[[ShortForm, Any], Mapping[str, Any]]
) -> Wiring:
    names, count = names_of(inst), len(inst.axes)
    drives: list[Plug] = []
    sensors: list[Plug] = []
    for n, (name, alone) in enumerate(zip(inst.axes, inst.planar, strict=True)):
        axis = getattr(settings, name)
        if axis is None:
            raise InstrumentError(f"devices.{key}.{name} is missing; {inst.name} has that axis.")
        drives += [
            Plug(f"the {side} drive of {name}", name, 2 * n + m, drive)
            for m, (side, drive) in enumerate(zip(TENDONS, axis.drives, strict=True))
        ]
        places = dict(zip(COLUMNS, (n, count + 2 * n, count + 2 * n + 1, 3 * count + n), strict=True))
        sensors += [Plug(what, name, places[what], source) for what, source in sources_of(alone, axis).items()]
    return Wiring(names, tuple(drives), tuple(sensors), ())


def _by_name(inst: Instrument, settings: CanOpen | NiDaq, key: str) -> Wiring:
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
            raise InstrumentError(f"devices.{key}.{group}.{missing} is missing; {inst.name} has it.")
        unknown = next((name for name in given if name not in there), None)
        if unknown is not None:
            allowed = ", ".join(there) or "left out"
            raise InstrumentError(f"devices.{key}.{group} names {unknown}; it must be among {allowed}.")
    handles, tensions = len(names.handle_joints), len(names.handle_joints) + len(names.tendons)
    drives = [
        Plug(f"the drive of {name}", name, names.tendons.index(name), part) for name, part in settings.tendons.items()
    ]
    sensors = [
        *(
            Plug("handle angle", name, names.handle_joints.index(name), part)
            for name, part in settings.handle_joints.items()
        ),
        *(Plug("tension", drive.of, handles + drive.place, drive.part.tension) for drive in drives),
        *(
            Plug("output angle", name, tensions + names.joints.index(name), part)
            for name, part in settings.joints.items()
        ),
    ]
    by_place = sorted(sensors, key=lambda plug: plug.place)
    return Wiring(names, tuple(sorted(drives, key=lambda plug: plug.place)), tuple(by_place), names.tendons)
