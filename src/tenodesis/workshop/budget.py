"""The tolerances of a scale model: the cheapest set of grades that keeps a target."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.errors import ArgumentError, StudyError
from tenodesis.instrument import Instrument, InstrumentLike, ShortForm, as_instrument, as_short_form, expanded
from tenodesis.run import Array
from tenodesis.scaling.plan import plain, quantity
from tenodesis.similarity import Comparison, compare
from tenodesis.similarity.parameters import field_of
from tenodesis.tolerance.evaluation import Cycle, angles_of_many, cycles, replaced
from tenodesis.workshop.grades import Grade, of_backbone, of_backlash, of_length, of_pretension, of_radius, of_stiffness
from tenodesis.workshop.joint_pair import JointPair

TARGET = 0.3
"""Default similarity error to keep, deg."""
SHARE = 0.95
"""Share of the instruments that must keep it."""
SAMPLES = 2000
"""Planar instruments drawn from the tolerances to verify them."""
JOINT_SAMPLES = 200
"""The same of several joints, whose loops take longer."""
PULLEY = "conditions.cable_pulley_radius"
BACKLASHES = ("distal_gear_backlash", "proximal_gear_backlash")
"""Play of gears along their pitch circle: no keys of an instrument file, since the tendons hold the halves' angles.

Tendons at the pitch radius hold the angle of a gear's far half whatever the play, to 0.01 deg for 0.15 mm; the play
turns the links. An encoder at a joint's axis reads the links' angle, doubled, and so what is counted is its error.
"""
_LENGTHS = ("end_effector_length", "handle_length", "overall_length", "backbone_length")
_SETTINGS = ("tendon_modulus", "tendon_stiffness", "pretension", "backbone_rigidity")
_STEP = 1e-3  # of a central difference, relative
_PLAY_STEP = 1e-6  # m
_WORTH = 0.01  # of the error: what a grade must lower it by for a cost of 1
_NEGLIGIBLE = 0.01  # of the target: the effect of a coarsest grade that needs no choice
_LEAST_QUANTILE = 1.6  # of a sum of uniform and normal values, standard deviations
_LOST = 1e9
_TRIED = 5  # sets of equal cost
_FRICTION = 0.2  # standard deviation of the coefficients, as tenodesis.tolerance has it
_FEWER = 4  # times fewer instruments for what is only reported


class TolerancedDimension(NamedTuple):
    """A dimension of the drawings, or a setting of the assembly, with its tolerance."""

    key: str
    """Key of the instrument file; of joints and tendons, what several alike have in common."""
    keys: tuple[str, ...]
    """Keys of the instrument file that have it."""
    nominal: float
    """SI units."""
    grade: Grade
    pieces: int
    share: float
    """Share of the error's variance where it is largest."""
    effect: float
    """Largest error that its width causes alone, deg."""
    is_drawn: bool
    """Whether a drawing has it; otherwise it is set or measured in assembly."""

    @property
    def tolerance(self) -> float:
        """Half width of a drawn dimension; standard deviation of a setting, SI units."""
        return self.grade.width

    @property
    def cost(self) -> float:
        """Relative cost: 1 is one part turned to general tolerances."""
        return self.grade.cost * self.pieces


class _Built(NamedTuple):
    """Instruments that values make, and what else differs from one to the other."""

    insts: list[ShortForm | None]
    load: Array
    """What their weights give over nominal."""
    misread: Array
    """By how much the encoders of handle and tip misread, rad, (2, n)."""


class Spread(NamedTuple):
    """The largest similarity error of drawn instruments, deg: median, and what the share of them keeps."""

    median: float
    kept: float
    lost: float
    """Share of the instruments whose tip is lost under a load; they count as keeping nothing."""


@dataclass(frozen=True)
class Budget:
    """The cheapest tolerances found that keep a similarity error; :func:`tolerate` makes it."""

    real_size: Instrument
    scaled_up: Instrument
    target: float
    """Similarity error to keep, deg."""
    share: float
    dimensions: Mapping[str, TolerancedDimension]
    """By key of the instrument file, the largest share of the error first."""
    forces: tuple[float, ...]
    """Test forces up to which the target is kept, N real-size; empty if it is kept at none."""
    by_force: Mapping[float, Spread]
    """What the drawn instruments keep at each test force that the nominal ones hold, N real-size."""
    built: Spread
    """Over the forces at which the target is to be kept; of all where it is kept at none."""
    designed: float
    """Largest error of the instrument as designed over the same forces, with friction, deg."""
    coarsest: Spread
    """With the cheapest grade of everything, at the same forces."""
    coarsest_shares: Mapping[str, float]
    with_friction: Spread
    """With the chosen tolerances and friction coefficients that differ by 20 % from the real-size ones."""
    play_as_made: float
    """What encoders at the joints' axes misread by gears as they are bought or made, deg; 0 without gears."""
    samples: int
    seed: int

    def __repr__(self) -> str:
        keeps = f"{100 * self.share:g} % keep {self.built.kept:.3g} deg"
        return f"<Budget of {self.scaled_up.name!r}: {len(self.dimensions)} dimensions, {keeps}, cost {self.cost:.3g}>"

    @property
    def cost(self) -> float:
        """Relative cost of all tolerances."""
        return sum(one.cost for one in self.dimensions.values())

    @property
    def drawn(self) -> dict[str, float]:
        """Half widths, m, of what drawings have, by key of the instrument file."""
        return {key: one.tolerance for one in self.dimensions.values() if one.is_drawn for key in one.keys}

    @property
    def has_friction(self) -> bool:
        """Whether the instrument has friction, whose coefficients may differ."""
        friction = self.scaled_up.friction
        return bool(friction.vertex_coefficient or friction.sheath_coefficient)

    @property
    def is_kept(self) -> bool:
        """Whether the target is kept, at one test force at least."""
        return bool(self.forces)


def tolerate(
    real_size: InstrumentLike,
    scaled_up: InstrumentLike,
    *,
    target: float = TARGET,
    share: float = SHARE,
    samples: int | None = None,
    seed: int = 0,
    backlash: float | None = None,
) -> Budget:
    """Find the cheapest tolerances with which a share of the scale models built keeps a similarity error.

    The error is the largest difference in output angle over a loop of the handle with friction, at every test force of
    the scaled-up instrument that both hold. Sets of grades are compared by linear propagation; the one taken is
    verified with instruments drawn from it on the quasi-static twin. Where no set keeps the target at the largest test
    force, the largest forces are left out until one does; where none keeps it at any, a finer grade is taken only where
    it lowers the error by 1 % for a cost of 1.

    Parameters
    ----------
    real_size, scaled_up
        The instruments: planar, of two axes the first; or of several joints, which are then each to keep the target in
        loops of every joint with friction, without and under the loads of the working range.
    target
        Similarity error to keep, deg.
    share
        Share of the instruments that keep it.
    samples, seed
        How many instruments are drawn, by default 2000 planar ones or 200 of several joints, and the seed.
    backlash
        Play of gears that are printed or milled, m along the pitch circle; by default gears are cut and bought.

    Raises
    ------
    StudyError
        The instruments cannot be compared, or the nominal ones do not hold the smallest test force.
    ValueError
        An argument is out of its range.
    """
    if isinstance(target, bool) or not 0 < target < np.inf:
        raise ArgumentError(key="target", value=target, allowed="an angle above 0 deg")
    if not 0.5 <= share < 1:
        raise ArgumentError(key="share", value=share, allowed="a share from 0.5 to below 1")
    planar = as_instrument(scaled_up, "scaled_up").short_form
    samples = (SAMPLES if planar is not None else JOINT_SAMPLES) if samples is None else samples
    if isinstance(samples, bool) or not isinstance(samples, int) or not 100 <= samples <= 100_000:
        raise ArgumentError(key="samples", value=samples, allowed="an integer from 100 to 100000")
    is_number = isinstance(backlash, int | float) and not isinstance(backlash, bool)
    if backlash is not None and not (is_number and 0 <= backlash < np.inf):
        raise ArgumentError(key="backlash", value=backlash, allowed="a length of at least 0 m, or None")
    pair: _Compared = (
        JointPair.of(expanded(real_size, "real_size"), expanded(scaled_up, "scaled_up"))
        if planar is None
        else _Pair.of(as_short_form(real_size, "real_size"), planar)
    )
    choosing = _Choosing(pair, target, share, samples, seed, backlash)
    every = len(pair.forces)
    for count in range(every, 0, -1):
        found = choosing.cheapest(count)
        if found is not None:
            taken, errors = found
            beyond = choosing.drawn(taken, range(count, every))
            return _budget(choosing, taken, np.concatenate([errors, beyond]), count, is_kept=True)
    taken = choosing.worthwhile
    return _budget(choosing, taken, choosing.drawn(taken, range(every)), every, is_kept=False)


class _Compared(Protocol):
    """A real-size instrument and its scale model, and the errors of models that are built to tolerances."""

    @property
    def real_size(self) -> Instrument: ...
    @property
    def scaled_up(self) -> Instrument: ...
    @property
    def forces(self) -> tuple[float, ...]: ...
    @property
    def columns(self) -> dict[str, dict[str, float]]: ...

    def grades(self, key: str, turn: float, backlash: float | None) -> tuple[Grade, ...]: ...
    def members(self, key: str) -> tuple[str, ...]: ...
    def is_drawn(self, key: str) -> bool: ...
    def pieces(self, key: str) -> int: ...
    def errors(self, built: Any, forces: Sequence[int] | None = None) -> Array: ...
    def built(self, keys: Sequence[str], rows: Array) -> Any: ...
    def nominal(self) -> Any: ...


@dataclass(frozen=True)
class _Pair:
    """Two instruments, their cycles of the handle, and the real-size output angles at every test force (N)."""

    real_size: ShortForm
    scaled_up: ShortForm
    comparison: Comparison
    forces: tuple[float, ...]
    cycle: Cycle
    scaled_up_cycle: Cycle
    reference: Array
    """rad, by force and step."""
    factor: float

    @classmethod
    def of(cls, real_size: ShortForm, scaled_up: ShortForm) -> "_Pair":
        real_size, scaled_up = real_size.planar[0], scaled_up.planar[0]
        try:
            comparison = compare(real_size, scaled_up)
        except ValueError as problem:
            raise StudyError(
                f"{scaled_up.name} for {real_size.name}: {problem}", key="scaled_up", value=scaled_up.name
            ) from None
        factor = float(comparison.force_factor())
        forces = sorted(force / factor for force in scaled_up.conditions.forces if force > 0)
        given = tuple(forces or sorted(force for force in real_size.conditions.forces if force > 0) or (1.0,))
        cycle, other = cycles(comparison)
        reference = np.array([angles_of_many([real_size], cycle, force)[0][0] for force in given])
        found = cls(real_size, scaled_up, comparison, given, cycle, other, reference, factor)
        held = np.array([not np.isnan(error).any() for error in found.errors(found.nominal())])
        if not held[0]:
            raise StudyError(
                f"{scaled_up.name} or {real_size.name} does not hold {given[0]:.4g} N (real-size) through its working "
                "range; use smaller test forces.",
                key="forces",
                value=given[0],
            )
        count = held.size if held.all() else int(held.argmin())
        return replace(found, forces=given[:count], reference=reference[:count])

    def errors(self, built: _Built, forces: Sequence[int] | None = None) -> Array:
        """Return errors as the tip's encoder has them, deg, by force, instrument and step.

        `forces` are the numbers of the test forces; by default all.
        """
        insts, load, (handle, tip) = built
        parts = []
        for n in range(len(self.forces)) if forces is None else forces:
            force, reference = self.forces[n], self.reference[n]
            angles, status = angles_of_many(insts, self.scaled_up_cycle, force * self.factor * load)
            angles[status != 0] = np.nan
            # The handle is led by its encoder.
            off = np.degrees(angles - reference + np.multiply.outer(handle, self.slope) + tip[:, np.newaxis])
            parts.append(np.concatenate([off[:, self.cycle.extension], off[:, self.cycle.flexion]], axis=1))
        return np.array(parts)

    @cached_property
    def slope(self) -> Array:
        """Output angle without load over the handle's angle, by step of the cycle."""
        turned, limit = np.asarray(self.scaled_up_cycle.handle), self.scaled_up.handle_range
        at = [np.clip(turned + step, -limit, limit) for step in (_STEP, -_STEP)]
        above, below = (statics.output_angle(self.scaled_up, one) for one in at)
        return np.asarray((above - below) / (at[0] - at[1]))

    def built(self, keys: Sequence[str], rows: Array) -> _Built:
        """Return the instruments that values by key (SI units) make."""
        load, misread = np.ones(len(rows)), np.zeros((2, len(rows)))
        if PULLEY in keys:
            load = rows[:, keys.index(PULLEY)] / _value(self.scaled_up, PULLEY)
        for place, (key, radius) in enumerate(zip(BACKLASHES[::-1], ("proximal_radius", "distal_radius"), strict=True)):
            if key in keys:
                misread[place] = rows[:, keys.index(key)] / _value(self.scaled_up, field_of(self.scaled_up, radius))
        own = [n for n, key in enumerate(keys) if key != PULLEY and key not in BACKLASHES]
        return _Built([replaced(self.scaled_up, {keys[n]: float(row[n]) for n in own}) for row in rows], load, misread)

    @property
    def columns(self) -> dict[str, dict[str, float]]:
        """Nominal values, SI units, by dimension and key."""
        return {key: {key: _value(self.scaled_up, key)} for key in _keys(self.scaled_up)}

    def grades(self, key: str, turn: float, backlash: float | None) -> tuple[Grade, ...]:
        """Return the grades of a dimension; `turn` is how far the tip turns (rad) per share of it."""
        inst = self.scaled_up
        nominal = _value(inst, key)
        if key in _LENGTHS:
            return of_length(nominal)
        if key in BACKLASHES:
            return of_backlash(_value(inst, key.replace("backlash", "radius")), backlash)
        if key == "pretension":
            return of_pretension(inst, nominal)
        if key == "backbone_rigidity":
            return of_backbone(nominal)
        return of_stiffness(nominal, turn) if key in _SETTINGS else of_radius(nominal)

    def members(self, key: str) -> tuple[str, ...]:
        """Return the keys of the instrument file that have a dimension."""
        return (key,)

    def is_drawn(self, key: str) -> bool:
        """Return whether a drawing has a dimension."""
        return key not in _SETTINGS and key not in BACKLASHES

    def pieces(self, key: str) -> int:
        """Return how many pieces have a dimension."""
        return _pieces(self.scaled_up, key)

    def nominal(self) -> _Built:
        """Return the instrument as designed."""
        return _Built([self.scaled_up], np.ones(1), np.zeros((2, 1)))


class _Choosing:
    """The grades of every dimension, the error's derivatives, and the sets of grades by cost."""

    def __init__(  # noqa: PLR0917
        self, pair: _Compared, target: float, share: float, samples: int, seed: int, backlash: float | None
    ) -> None:
        self.pair, self.target, self.share, self.samples, self.seed = pair, target, share, samples, seed
        self.columns = pair.columns
        self.keys = list(self.columns)
        self.of = np.array([n for n, own in enumerate(self.columns.values()) for _ in own])
        """Dimension of each key of the instrument file."""
        self.names = [key for own in self.columns.values() for key in own]
        self.values = np.array([value for own in self.columns.values() for value in own.values()])
        values = self.values
        steps = np.where(values > 0, _STEP * values, _PLAY_STEP)
        shifted = np.concatenate([values + sign * np.diag(steps) for sign in (1, -1)])
        at = pair.errors(pair.built(self.names, shifted))
        count = len(values)
        # By force, key and step: deg per SI unit.
        slopes = (at[:, :count] - at[:, count:]) / (2 * steps[:, np.newaxis])
        # A tip that is lost so near to the nominal one is lost within any tolerance.
        self.slopes = np.nan_to_num(slopes, nan=_LOST)
        self.designed = pair.errors(pair.nominal())[:, 0]
        self.grades = [pair.grades(key, self._turn(n), backlash) for n, key in enumerate(self.keys)]
        random = np.random.default_rng(seed)
        normal, uniform = random.standard_normal((samples, count)), random.uniform(-1, 1, (samples, count))
        self.draws = np.where([self.grades[n][0].is_normal for n in self.of], normal, uniform)

    def _turn(self, n: int) -> float:
        """Return how far the tip turns, rad, per share of a dimension."""
        own = np.flatnonzero(self.of == n)
        turns = np.radians(np.abs(self.slopes[:, own]).max(axis=(0, 2))) * self.values[own]
        return float(max(turns[turns < _LOST], default=0.0))

    def _widths(self, taken: Sequence[Grade]) -> Array:
        """Return the width of every key, SI units."""
        widths: Array = np.array([one.width for one in taken])[self.of]
        return widths

    def _power(self, slopes: Array) -> Array:
        """Return the square of the error by a width of one, by dimension and step, from slopes by key and step."""
        return np.array([(slopes[self.of == n] ** 2).sum(axis=0) for n in range(len(self.keys))])

    @property
    def worthwhile(self) -> tuple[Grade, ...]:
        """The finest grade of everything, made cheaper for as long as that costs little error for what it saves."""
        places = [len(one) - 1 for one in self.grades]
        designed, slopes = np.concatenate(self.designed), np.concatenate(self.slopes, axis=1)
        pieces = [self.pair.pieces(key) for key in self.keys]

        def kept(at: Sequence[int]) -> float:
            widths = self._widths([one[place] for one, place in zip(self.grades, at, strict=True)])
            errors = np.abs(designed + (self.draws[::_FEWER] * widths) @ slopes).max(axis=1)
            return float(np.quantile(errors, self.share))

        error = kept(places)
        while True:
            cheaper = []
            for n, place in enumerate(places):
                if place:
                    at = [*places[:n], place - 1, *places[n + 1 :]]
                    saved = pieces[n] * (self.grades[n][place].cost - self.grades[n][place - 1].cost)
                    found = kept(at)
                    cheaper.append(((found / error - 1) / saved, found, at))
            least = min(cheaper, default=None)
            if least is None or least[0] > _WORTH:
                return tuple(one[place] for one, place in zip(self.grades, places, strict=True))
            _, error, places = least

    @property
    def coarsest(self) -> tuple[Grade, ...]:
        """The cheapest grade of everything."""
        return tuple(one[0] for one in self.grades)

    def cheapest(self, count: int) -> tuple[tuple[Grade, ...], Array] | None:
        """Return the cheapest set that keeps the target at the smallest test forces, as many as `count`.

        With it comes what its instruments keep, as :meth:`drawn`; None if no set does.
        """
        designed = np.concatenate(self.designed[:count])
        slopes = np.concatenate(self.slopes[:count], axis=1)
        for taken in self._by_cost(slopes):
            widths = self._widths(taken)
            # Most sets miss by so much that a few instruments show it.
            if any(
                np.quantile(np.abs(designed + (draws * widths) @ slopes).max(axis=1), self.share) > bound
                for draws, bound in ((self.draws[::_FEWER], 1.1 * self.target), (self.draws, self.target))
            ):
                continue
            # The largest force first, at which most sets fail.
            last = self.drawn(taken, (count - 1,))
            if _spread(last[0], self.share).kept <= self.target:
                errors = np.concatenate([self.drawn(taken, range(count - 1)), last])
                if _spread(errors.max(axis=0), self.share).kept <= self.target:
                    return taken, errors
        return None

    def _by_cost(self, slopes: Array) -> Iterator[tuple[Grade, ...]]:
        """Yield sets of grades that may keep the target, by rising cost; of equal costs those with the least error."""
        power = self._power(slopes)
        effect = np.sqrt(power.max(axis=1))
        # A grade without effect needs no choice.
        choices = [
            one[:1] if one[0].width * effect[n] < _NEGLIGIBLE * self.target else one
            for n, one in enumerate(self.grades)
        ]
        at = np.unique(power.argmax(axis=1))
        variance, cost = np.zeros((1, at.size)), np.zeros(1)
        picked: NDArray[np.intp] = np.zeros((1, 0), np.intp)
        most = (self.target / _LEAST_QUANTILE) ** 2
        for n, offered in enumerate(choices):
            own = np.array([_variance(one) * power[n, at] for one in offered])
            price = np.array([one.cost * self.pair.pieces(self.keys[n]) for one in offered])
            places = np.indices((len(variance), len(offered))).reshape(2, -1)
            variance, cost = variance[places[0]] + own[places[1]], cost[places[0]] + price[places[1]]
            picked = np.concatenate([picked[places[0]], places[1][:, np.newaxis]], axis=1)
            # What is too wide already stays so.
            possible = variance.max(axis=1) <= most
            variance, cost, picked = variance[possible], cost[possible], picked[possible]
        order = np.lexsort((np.sqrt(variance.max(axis=1)), cost.round(6)))
        for _, same in groupby(order.tolist(), key=lambda number: round(float(cost[number]), 6)):
            for number in list(same)[:_TRIED]:
                yield tuple(one[n] for one, n in zip(choices, picked[number].tolist(), strict=True))

    def drawn(self, taken: Sequence[Grade], forces: Sequence[int], *, friction: float = 0.0, fewer: int = 1) -> Array:
        """Return the largest error, deg, of drawn instruments at some of the forces; infinite where a tip is lost."""
        if not len(forces):
            return np.empty((0, self.samples // fewer))
        draws = self.draws[: self.samples // fewer]
        built = self.pair.built(self.names, self.values + draws * self._widths(taken))
        if friction:
            random = np.random.default_rng(self.seed + 1)
            built = built._replace(insts=[_with_friction(one, random.normal(1, friction, 2)) for one in built.insts])
        errors = np.abs(self.pair.errors(built, forces)).max(axis=2)
        return np.where(np.isnan(errors), np.inf, errors)

    def shares(self, taken: Sequence[Grade], count: int) -> Array:
        """Return each dimension's share of the error's variance where that is largest."""
        slopes = np.concatenate(self.slopes[:count], axis=1)
        variance = np.array([[_variance(one)] for one in taken]) * self._power(slopes)
        worst = variance[:, variance.sum(axis=0).argmax()]
        found: Array = worst / (worst.sum() or 1.0)
        return found


def _budget(choosing: _Choosing, taken: tuple[Grade, ...], errors: Array, count: int, *, is_kept: bool) -> Budget:
    """Return the budget of a set of grades, with the errors of its instruments by force."""
    pair = choosing.pair
    shares = choosing.shares(taken, count)
    slopes = np.abs(np.concatenate(choosing.slopes[:count], axis=1)).max(axis=1)
    effect = [float(slopes[choosing.of == n].max()) for n in range(len(choosing.keys))]
    dimensions = [
        TolerancedDimension(
            key, pair.members(key), next(iter(choosing.columns[key].values())), grade, pair.pieces(key),
            float(shares[n]), effect[n] * grade.width, pair.is_drawn(key),
        )
        for n, (key, grade) in enumerate(zip(choosing.keys, taken, strict=True))
    ]  # fmt: skip
    coarsest = choosing.coarsest

    def reported(chosen: tuple[Grade, ...], friction: float = 0.0) -> Spread:
        drawn = choosing.drawn(chosen, range(count), friction=friction, fewer=_FEWER)
        return _spread(drawn.max(axis=0), choosing.share)

    return Budget(
        pair.real_size,
        pair.scaled_up,
        choosing.target,
        choosing.share,
        {one.key: one for one in sorted(dimensions, key=lambda one: -one.share)},
        pair.forces[:count] if is_kept else (),
        {force: _spread(one, choosing.share) for force, one in zip(pair.forces, errors, strict=True)},
        _spread(errors[:count].max(axis=0), choosing.share),
        float(np.abs(choosing.designed[:count]).max()),
        reported(coarsest),
        dict(zip(choosing.keys, choosing.shares(coarsest, count).tolist(), strict=True)),
        reported(taken, _FRICTION),
        sum(
            effect[choosing.keys.index(key)] * choosing.grades[choosing.keys.index(key)][0].width
            for key in BACKLASHES
            if key in choosing.keys
        ),
        choosing.samples,
        choosing.seed,
    )


def _keys(inst: ShortForm) -> Iterator[str]:
    for parameter in ("distal_radius", "proximal_radius"):
        yield field_of(inst, parameter)
    for key in _LENGTHS:
        if getattr(inst, key, None):
            yield key
    if inst.conditions.cable_pulley_radius:
        yield PULLEY
    if inst.joint_type == "tendon-gear":
        yield from BACKLASHES
    yield "tendon_stiffness" if inst.given_stiffness is not None else "tendon_modulus"
    if inst.pretension > 0:
        yield "pretension"
    if getattr(inst, "backbone_rigidity", None):
        yield "backbone_rigidity"


def _value(inst: ShortForm, key: str) -> float:
    if key in BACKLASHES:
        return 0.0
    return float((inst.conditions.cable_pulley_radius or 0.0) if key == PULLEY else getattr(inst, key))


def _pieces(inst: ShortForm, key: str) -> int:
    """Return how many pieces of one axis have a dimension: a joint of gears has two of them."""
    return 2 if key.endswith("gear_radius") else 1


def _variance(grade: Grade) -> float:
    return grade.width**2 * (1.0 if grade.is_normal else 1 / 3)


def _with_friction(inst: Any, factors: NDArray[np.float64]) -> Any:
    if inst is None:
        return None
    friction = inst.friction
    vertex, sheath = np.maximum(factors, 0.0) * (friction.vertex_coefficient, friction.sheath_coefficient)
    return inst.replace(**{"friction.vertex_coefficient": float(vertex), "friction.sheath_coefficient": float(sheath)})


def _spread(errors: Array, share: float) -> Spread:
    ordered = np.sort(errors)
    at = min(int(np.ceil(share * ordered.size)), ordered.size) - 1
    return Spread(float(np.median(errors)), float(ordered[at]), float(np.isinf(errors).mean()))


NAMES = {
    "distal_gear_radius": "distal gears, axis to tunnel",
    "proximal_gear_radius": "proximal gears, axis to tunnel",
    "distal_pulley_radius": "distal pulley, to rope's centre",
    "proximal_pulley_radius": "proximal pulley, to rope's centre",
    "distal_tendon_offset": "discs, backbone to tendon",
    "end_effector_length": "distal joint to tip l_d",
    "handle_length": "proximal joint to hand l_p",
    "overall_length": "overall length L",
    "backbone_length": "backbone length",
    PULLEY: "load rig's pulley, to cable's centre",
    "distal_gear_backlash": "distal gears, play at the encoder",
    "proximal_gear_backlash": "proximal gears, play at the encoder",
    "tendon_modulus": "tendons' modulus",
    "tendon_stiffness": "tendons' stiffness",
    "pretension": "pretension",
    "backbone_rigidity": "backbone's rigidity",
}
"""Dimensions and settings of planar instruments by key of the instrument file."""


def named(key: str) -> str:
    """Return the name of a dimension."""
    return NAMES.get(key, key)


_UNITS = {
    "tendon_modulus": ("GPa", "Pa"),
    "tendon_stiffness": ("N/mm", "N/m"),
    "pretension": ("N", "N"),
    "backbone_rigidity": ("N*mm^2", "N*m^2"),
}


def _unit(one: TolerancedDimension) -> tuple[str, str]:
    """Return the unit that a value is shown in, and its SI unit."""
    listed, key = one.keys[0].partition(".")[0], one.keys[0].rpartition(".")[2]
    if key == "stiffness":
        return ("N/mm", "N/m") if listed == "tendons" else ("N*mm", "N*m")
    return _UNITS.get(key, ("mm", "m"))


def nominal(one: TolerancedDimension) -> str:
    """Return the nominal value with its unit."""
    unit, si = _unit(one)
    return quantity(one.nominal, unit, 6, si)


def tolerance(one: TolerancedDimension) -> str:
    """Return the tolerance with its unit: plus or minus, or the standard deviation of a setting in percent."""
    if one.grade.is_normal:
        return f"s = {plain(100 * one.tolerance / one.nominal, 2)} %"
    return f"± {quantity(one.tolerance, 'mm', 3, 'm')}"
