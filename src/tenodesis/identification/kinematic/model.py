"""Coupling, play and offset of joints from commanded and measured angles alone, of any instrument.

Of joint i, with the commands c, the effort e of its drive if it was recorded, and the play p of its tendons:

    x[i] = offset[i] + gain[i] c[i] + sum of coupling[i, j] c[j] + compliance[i] e[i] + sum of follow[i, j] (q - x)[j]
    q[i] = x[i] behind play: it stays while |x[i] - q[i]| <= p[i] / 2, and is pushed by the ends of that band

| law | joint behind | source |
|---|---|---|
| none | x itself | |
| play | one play | |
| soft | the mean of several plays, spread evenly from p (1 - softness) to p | Prandtl, Ishlinskii |
| passed | one play; joints j before pass on what their own plays keep, by follow[i, j], which is zero of other laws | |

`auto` takes for each joint the law that predicts parts of the recordings which it was not fitted to best, the simplest
within a standard error, or 2 %, of that (Breiman et al. 1984). Then it adds a
delay of the commands, c(t - delay[i]), where that is better in the same way.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from tenodesis.errors import ArgumentError, IdentificationError
from tenodesis.identification.datasets.reference import Values, held
from tenodesis.identification.formats.measured import MeasuredRun, Raw
from tenodesis.identification.problem import Parameter, Problem, Trace, complex_step
from tenodesis.run import Array

LAWS = ("auto", "none", "play", "soft", "passed")
"""Laws by name, the simplest first after auto."""
COMMAND, MEASURED, EFFORT = "command", "measured", "effort"
ELEMENTS = 6
"""Plays that a soft one is made of."""
FOLDS = 5
"""Parts of the recordings, each left out once to choose a law."""
INTERVAL = 0.01
"""Time between the samples that are fitted at least, s."""
_LEAST_MOTION = float(np.radians(1))
"""Spread of a command below which a joint stands still, rad."""
_LEAST_NOISE = 1e-5
"""Of a sensor that shows no noise, rad."""
_MOST_DELAY = 0.5
"""s."""
_MOST_GAIN = 5.0
_PER_DEGREE = float(np.radians(1))
_LIKE = 1.2
"""Factor within which a gain is one degree or one radian."""
_MOST_PLAY = 3.0
"""rad."""
_HARDLY = 0.04
"""Share of the mean square by which a law hardly differs from a simpler one: 2 % of the error."""
_EVALUATIONS = 30
_STARTS = (0.05, 0.4, 1.0)
"""Where a search for the play begins, as shares of the spread that commands alone leave."""


def recorded(
    time: Array,
    command: Mapping[str, Array],
    measured: Mapping[str, Array],
    *,
    effort: Mapping[str, Array] | None = None,
    name: str = "run",
    notes: Sequence[str] = (),
) -> MeasuredRun:
    """Return a recording of commanded and measured joint angles to identify from.

    Parameters
    ----------
    time
        s, (n,).
    command, measured
        Angles by joint, rad, each (n,). A joint that was commanded but not measured may move others.
    effort
        Torque or current of a joint's drive, in any one unit.

    Raises
    ------
    IdentificationError
        No joint has both angles, none of these moves, or the recording is too short or has too many corrupt rows.
    """
    if not set(command) & set(measured):
        raise IdentificationError(
            f"{name}: no joint has a commanded and a measured angle: commanded are {', '.join(command) or 'none'}, "
            f"measured {', '.join(measured) or 'none'}.",
            key="columns",
            value=[*command, *measured],
        )
    groups = ((COMMAND, command), (MEASURED, measured), (EFFORT, effort or {}))
    raw = Raw(name, time, {f"{kind}.{joint}": values for kind, group in groups for joint, values in group.items()})
    for note in (*notes, *_one_sided(command, measured)):
        raw.note(note)
    raw.finite()
    raw.clock()
    raw.enough()
    raw.gaps()
    run = raw.done()
    alone = {
        joint: np.degrees(np.std(run[f"{MEASURED}.{joint}"] - run[f"{COMMAND}.{joint}"])) for joint in joints_of([run])
    }
    if not alone:
        raise IdentificationError(f"{name}: no joint that was measured moves.", key="columns", value=[*measured])
    for joint in alone:
        _check_units(run, joint)
    left = ", ".join(f"{value:.3g} deg ({joint})" for joint, value in alone.items())
    note = f"the commands alone leave {left}, root mean square beside an offset"
    return MeasuredRun(run.name, run.time, run.columns, (*run.notes, note))


def _one_sided(command: Mapping[str, Array], measured: Mapping[str, Array]) -> list[str]:
    """Return notes on joints that were not commanded, or not measured."""
    alone = [one for one in measured if one not in command]
    moving = [one for one in command if one not in measured]
    found = [f"{', '.join(alone)} measured, but not commanded: left out"] if alone else []
    return found + ([f"{', '.join(moving)} commanded, but not measured: moves others at most"] if moving else [])


def _check_units(run: MeasuredRun, joint: str) -> None:
    """Refuse a joint that moves as if one of its angles were in degrees under a heading in radians."""
    commands = [name for name in run.columns if name.startswith(f"{COMMAND}.")]
    columns = np.column_stack([np.ones(len(run)), *(run[name] for name in commands)])
    found = np.linalg.lstsq(columns, run[f"{MEASURED}.{joint}"])[0]
    gain = abs(float(found[1 + commands.index(f"{COMMAND}.{joint}")]))
    degrees = next((one for one in (_PER_DEGREE, 1 / _PER_DEGREE) if one / _LIKE < gain < one * _LIKE), None)
    if degrees is None and gain <= _MOST_GAIN:
        return
    less = "command" if gain < 1 else "measured angle"
    why = "" if degrees is None else f", as if its {less} were in degrees under a heading in radians"
    raise IdentificationError(
        f"{run.name}: {joint} turns by {gain:.3g} times its command{why}; both must be in the unit of their heading.",
        key=joint,
        value=gain,
        allowed="angles in the unit of their heading",
    )


def is_kinematic(run: MeasuredRun) -> bool:
    """Return whether a recording holds commanded and measured joint angles."""
    return any(name.startswith(f"{COMMAND}.") for name in run.columns)


def joints_of(runs: Sequence[MeasuredRun]) -> tuple[str, ...]:
    """Return the joints that were measured and commanded in all recordings, and moved in one of them."""
    common = set.intersection(*(set(_both(run)) for run in runs))
    return tuple(one for one in _both(runs[0]) if one in common and _moves(runs, one))


class _Series(NamedTuple):
    """A recording as it is compared: time (n,), and by joint commands, measured angles and efforts, each (n,)."""

    time: Array
    command: Mapping[str, Array]
    measured: Mapping[str, Array]
    effort: Mapping[str, Array]

    def part(self, first: int, last: int) -> "_Series":
        """Return a stretch of it."""
        groups = ({name: one[first:last] for name, one in group.items()} for group in self[1:])
        return _Series(self.time[first:last], *groups)


class _Joint(NamedTuple):
    """A measured joint: its law, and the joints whose commands and whose plays move it."""

    name: str
    law: str
    movers: tuple[str, ...]
    before: tuple[str, ...]
    effort: bool
    delay: bool = False

    @property
    def label(self) -> str:
        """The law, and whether the effort and a delay count."""
        return " and ".join([self.law] + ["effort"] * self.effort + ["delay"] * self.delay)

    def parameters(self) -> list[Parameter]:
        """Return its unknowns."""
        name, others = self.name, [one for one in self.movers if one != self.name]
        found = [
            Parameter(f"offset.{name}", "rad", 0.0, -7.0, 7.0, "Measured angle at the command zero", "offsets"),
            Parameter(f"gain.{name}", "1", 1.0, -_MOST_GAIN, _MOST_GAIN, "Angle by its own command", "coupling"),
        ]
        found += [
            Parameter(f"coupling.{name}.{other}", "1", 0.0, -5.0, 5.0, f"Angle by the command of {other}", "coupling")
            for other in others
        ]
        if self.effort:
            meaning = "Angle by the effort of its drive, per unit of the file"
            found.append(Parameter(f"compliance.{name}", "rad", 0.0, -100.0, 100.0, meaning, "stiffness"))
        if self.law != "none":
            meaning = "Command that turns the joint by nothing after a reversal"
            found.append(Parameter(f"play.{name}", "rad", 0.02, 0.0, _MOST_PLAY, meaning, "play"))
        if self.law == "soft":
            meaning = "Share of the play within which the joint follows in part"
            found.append(Parameter(f"softness.{name}", "1", 0.5, 0.0, 1.0, meaning, "play"))
        if self.law == "passed":
            found += [
                Parameter(f"follow.{name}.{other}", "1", 0.0, -5.0, 5.0, f"Angle by what {other} lags", "coupling")
                for other in self.before
            ]
        if self.delay:
            meaning = "Time by which it is later than its commands"
            found.append(Parameter(f"delay.{name}", "s", 0.02, 0.0, _MOST_DELAY, meaning, "delay"))
        return found

    def angle(self, given: Mapping[str, Any], series: _Series, kept: Mapping[str, Values]) -> tuple[Values, Values]:
        """Return the joint's angle and what its play adds to it, each (n,), given what the plays before it add.

        Raises KeyError without those before it.
        """
        name, late = self.name, given.get(f"delay.{self.name}", 0.0)
        command = {other: _delayed(series.time, series.command[other], late) for other in self.movers}
        moved = given[f"offset.{name}"] + given[f"gain.{name}"] * command[name]
        for other in self.movers:
            if other != name:
                moved = moved + given[f"coupling.{name}.{other}"] * command[other]
        if self.effort:
            moved = moved + given[f"compliance.{name}"] * series.effort[name]
        if self.law == "passed":
            for other in self.before:
                moved = moved + given[f"follow.{name}.{other}"] * kept[other]
        moved = np.asarray(moved)
        if self.law == "none":
            return moved, np.zeros(moved.size)
        start = series.measured[name][0]
        half = given[f"play.{name}"] / 2
        softness = given[f"softness.{name}"] if self.law == "soft" else 0.0
        shares = np.linspace(0, 1, ELEMENTS) if self.law == "soft" else np.zeros(1)
        plays = [_behind_play(moved, half * (1 - softness * share), start) for share in shares]
        turned = np.asarray(sum(plays) / len(plays))
        return turned, turned - moved


class Kinematic(Problem):
    """Joints behind play with the recordings of their commands and angles, of :func:`recorded`.

    A joint's play begins where the first sample measured it. Raises ArgumentError if there is no such law, and
    IdentificationError if nothing that all recordings hold can be fitted.
    """

    def __init__(self, train: Sequence[MeasuredRun], test: Sequence[MeasuredRun] = (), *, law: str = "auto") -> None:
        if law not in LAWS:
            raise ArgumentError(key="law", value=law, allowed=f"one of {', '.join(LAWS)}")
        if not train:
            raise IdentificationError("train is empty; it must hold at least one recording.", key="train")
        recordings = [*train, *test]
        names = joints_of(train)
        lacking = [one.name for one in recordings if not set(names) <= set(_both(one))]
        if not names or lacking:
            where = lacking[0] if lacking else train[0].name
            raise IdentificationError(
                f"{where} lacks command and measured angle of one of {', '.join(names) or 'its joints'}.",
                key="columns",
                value=where,
            )
        self.runs = tuple(one.name for one in recordings)
        movers = [name for name in _commanded(recordings) if _moves(train, name)]
        with_effort = [one for one in names if all(f"{EFFORT}.{one}" in run.columns for run in recordings)]
        self.full = [_series(one, movers, names, with_effort) for one in recordings]
        self.fitted = [_thinned(one) for one in self.full]
        self.noise = {name: _noise([one.measured[name] for one in self.fitted[: len(train)]]) for name in names}
        self.joints: list[_Joint] = []
        starts: dict[str, float] = {}
        self.compared: dict[str, dict[str, float]] = {}
        """Error in parts left out, rad, by joint and law, where laws were compared."""
        kept: list[dict[str, Values]] = [{} for _ in train]
        for name in names:
            laws = [one for one in (LAWS[1:] if law == "auto" else (law,)) if one != "passed" or self.joints]
            efforts = [False, True] if law == "auto" and name in with_effort else [name in with_effort]
            before_it = tuple(before.name for before in self.joints)
            options = [
                _Joint(name, one, tuple(movers), before_it, effort) for effort in efforts for one in laws or ["play"]
            ]
            joint = self._chosen(options, self.fitted[: len(train)], kept) if options[1:] else options[0]
            if law == "auto" and joint.law != "none":
                late = joint._replace(delay=True)
                joint = self._chosen([joint, late], self.fitted[: len(train)], kept)
            found = _solved(joint, self.fitted[: len(train)], kept)
            for one, before in zip(self.fitted, kept, strict=False):
                before[name] = joint.angle(found, one, before)[1]
            self.joints.append(joint)
            starts |= found
        self.parameters = tuple(
            one._replace(start=float(np.clip(starts[one.name], one.lower, one.upper)))
            for joint in self.joints
            for one in joint.parameters()
        )

    @cached_property
    def _places(self) -> dict[str, int]:
        return {one.name: place for place, one in enumerate(self.parameters)}

    def _chosen(
        self, options: Sequence[_Joint], train: Sequence[_Series], kept: Sequence[Mapping[str, Values]]
    ) -> _Joint:
        """Return the simplest option whose error in parts left out is within a standard error of the least."""
        parts = [
            (one.part(first, last), {name: values[first:last] for name, values in before.items()})
            for one, before in zip(train, kept, strict=True)
            for first, last in _parts(one.time.size, -(-FOLDS // len(train)))
        ]
        folds = [parts[fold::FOLDS] for fold in range(min(FOLDS, len(parts)))]
        errors = {}
        whole: dict[str, float] = {}
        for option in options:
            near = (
                whole if (option.delay or option.law in ("soft", "passed")) and f"play.{option.name}" in whole else None
            )
            whole = _solved(option, train, kept, near=near)
            squares = []
            for number, fold in enumerate(folds):
                rest = [part for other, one in enumerate(folds) if other != number for part in one]
                found = _solved(option, [one for one, _ in rest], [before for _, before in rest], near=whole)
                left = [one.measured[option.name] - option.angle(found, one, before)[0] for one, before in fold]
                squares.append(float(np.mean(np.concatenate(left) ** 2)))
            errors[option.label] = np.array(squares)
        self.compared.setdefault(options[0].name, {}).update(
            {name: float(np.sqrt(one.mean())) for name, one in errors.items()}
        )
        best = min(errors, key=lambda name: errors[name].mean())

        def no_worse(name: str) -> bool:
            # folds differ by their motions: what counts is the spread of the differences within them
            more = errors[name] - errors[best]
            return bool(more.mean() <= max(more.std() / np.sqrt(more.size - 1), _HARDLY * errors[best].mean()))

        return next(one for one in options if no_worse(one.label))

    def model(self, values: Values, series: _Series) -> dict[str, Values]:
        """Return the angles by joint, each (n,), rad."""
        return self._turned(values, series)[0]

    def _turned(self, values: Values, series: _Series) -> tuple[dict[str, Values], dict[str, Values]]:
        """Return the angles by joint, and what plays add to them, each (n,), rad."""
        given = dict(zip((one.name for one in self.parameters), values, strict=True))
        found: dict[str, Values] = {}
        kept: dict[str, Values] = {}
        for joint in self.joints:
            found[joint.name], kept[joint.name] = joint.angle(given, series, kept)
        return found, kept

    def predict(self, values: Array, run: int) -> dict[str, Array]:
        """Return the modelled angle of each joint at all samples of a recording, each (n,), rad."""
        return self.model(values, self.full[run])

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus modelled angles, joint after joint, in standard deviations of their sensors."""
        series = self.fitted[run]
        found = self.model(values, series)
        return np.concatenate([(series.measured[name] - one) / self.noise[name] for name, one in found.items()])

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the exact derivatives of the residuals, (n, parameters)."""
        series = self.fitted[run]
        given = dict(zip(self._places, values.tolist(), strict=True))
        base = self._turned(values, series)[1]
        size = series.time.size
        slopes = np.zeros((len(self.joints) * size, values.size))
        for name, place in self._places.items():
            changed = given | {name: given[name] + 1e-30j}
            found: dict[str, Values] = {}
            for row, joint in enumerate(self.joints):
                # a joint that passes nothing on depends on its own parameters alone
                if name.split(".")[1] == joint.name or (joint.law == "passed" and found):
                    turned, found[joint.name] = joint.angle(changed, series, base | found)
                    slopes[row * size : (row + 1) * size, place] = -np.imag(turned) / self.noise[joint.name]
        return slopes / 1e-30

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus modelled angle of each joint at all samples, deg."""
        return {key: one.measured - one.model for key, one in self.traces(values, run).items()}

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return the measured and the modelled angle of each joint at all samples, deg."""
        series = self.full[run]
        return {
            f"{name}_angle_deg": Trace(series.time, np.degrees(series.measured[name]), np.degrees(one))
            for name, one in self.model(values, series).items()
        }

    def sample_time(self, run: int) -> float:
        """Return the time between the samples that are fitted, s."""
        return float(np.median(np.diff(self.fitted[run].time)))

    def channels(self, run: int) -> int:
        """Return how many joints the residuals hold."""
        return len(self.joints)

    def sensors(self, run: int) -> tuple[str, ...]:
        """Return the names of the joints."""
        return tuple(one.name for one in self.joints)

    def coupling(self, values: Array) -> tuple[tuple[str, ...], Array]:
        """Return the commanded joints, and the measured joints' angles by their commands (measured, commanded)."""
        movers = self.joints[0].movers
        rows = np.zeros((len(self.joints), len(movers)))
        for row, joint in enumerate(self.joints):
            for column, other in enumerate(movers):
                name = f"gain.{other}" if other == joint.name else f"coupling.{joint.name}.{other}"
                rows[row, column] = values[self._places[name]]
        return movers, rows

    def advice(self, names: Sequence[str]) -> str | None:
        """Return which motion would make these parameters identifiable."""
        words = {name.partition(".")[0] for name in names}
        if words & {"gain", "coupling", "follow"}:
            return "Move one joint at a time, over its whole range, and then all at frequencies of their own."
        if words & {"play", "softness"}:
            return "Turn each joint back and forth by a few degrees in several places, and by less than its play."
        return None


def chosen_laws(problem: Problem) -> tuple[str, ...]:
    """Return which law each joint has, and what those that were compared leave where they were not fitted."""
    if not isinstance(problem, Kinematic):
        return ()
    said = []
    for joint in problem.joints:
        compared = problem.compared.get(joint.name, {})
        left = ", ".join(f"{law} {np.degrees(error):.3g}" for law, error in compared.items())
        said.append(f"{joint.name}: {joint.label}" + (f" (deg left in parts not fitted: {left})." if left else "."))
    return tuple(said)


def _delayed(time: Array, values: Array, late: Any) -> Values:
    """Return a signal as it was a time before, complex where that time is."""
    if not late:
        return values
    at = time - np.real(late)
    place = np.clip(np.searchsorted(time, at, side="right") - 1, 0, time.size - 2)
    slope = np.where(at < time[0], 0.0, (np.diff(values) / np.diff(time))[place])
    return np.asarray(np.interp(at, time, values) - (1j * np.imag(late) * slope if np.imag(late) else 0.0))


def _behind_play(moved: Values, half: Any, start: float) -> Values:
    lower, upper = moved - half, moved + half
    return held(np.asarray(lower), np.asarray(upper), start)


def _solved(
    joint: _Joint,
    runs: Sequence[_Series],
    kept: Sequence[Mapping[str, Values]],
    *,
    near: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return a joint's parameters by least squares over recordings, near some, or from several starts of its play."""
    parameters = joint.parameters()
    names = [one.name for one in parameters]
    lower, upper = (np.array([getattr(one, end) for one in parameters]) for end in ("lower", "upper"))
    reference = np.concatenate([one.measured[joint.name] for one in runs])

    def angle(values: Values) -> Values:
        given = dict(zip(names, values, strict=True))
        return np.concatenate([joint.angle(given, one, before)[0] for one, before in zip(runs, kept, strict=True)])

    # without play the model is a sum of columns
    linear = joint._replace(law="none", delay=False)
    count = len(linear.parameters())
    units = [dict(zip(names, row, strict=False)) for row in np.eye(count)]
    columns = np.concatenate([np.column_stack([linear.angle(unit, one, {})[0] for unit in units]) for one in runs])
    first = np.array([one.start for one in parameters])
    first[:count] = np.clip(np.linalg.lstsq(columns, reference)[0], lower[:count], upper[:count])
    if joint.law == "none":
        return dict(zip(names, first.tolist(), strict=True))
    play = names.index(f"play.{joint.name}")
    spread = 2 * np.sqrt(3) * float(np.std(reference - columns @ first[:count]))
    starts = [np.where(np.arange(first.size) == play, share * spread, first) for share in _STARTS]
    if near is not None:
        starts = [np.array([near.get(one.name, one.start) for one in parameters])]
    ends = [
        optimize.least_squares(
            lambda at: np.real(angle(at)) - reference,  # type: ignore[misc]
            np.clip(start, lower, upper),
            partial(complex_step, angle),
            bounds=(lower, upper),
            x_scale="jac",
            max_nfev=_EVALUATIONS,
        )
        for start in starts
    ]
    return dict(zip(names, min(ends, key=lambda end: float(end.cost)).x.tolist(), strict=True))


def _both(run: MeasuredRun) -> list[str]:
    names = [name.removeprefix(f"{MEASURED}.") for name in run.columns if name.startswith(f"{MEASURED}.")]
    return [one for one in names if f"{COMMAND}.{one}" in run.columns]


def _commanded(runs: Sequence[MeasuredRun]) -> list[str]:
    first = [name for name in runs[0].columns if name.startswith(f"{COMMAND}.")]
    return [name.removeprefix(f"{COMMAND}.") for name in first if all(name in run.columns for run in runs)]


def _moves(runs: Sequence[MeasuredRun], joint: str) -> bool:
    return max(float(np.ptp(run[f"{COMMAND}.{joint}"])) for run in runs) >= _LEAST_MOTION


def _series(run: MeasuredRun, movers: Sequence[str], measured: Sequence[str], with_effort: Sequence[str]) -> _Series:
    groups = ((COMMAND, movers), (MEASURED, measured), (EFFORT, with_effort))
    return _Series(run.time, *({name: run[f"{kind}.{name}"] for name in names} for kind, names in groups))


def _thinned(one: _Series) -> _Series:
    """Return every so many samples, where they are closer than the fitted interval."""
    step = max(1, round(INTERVAL / float(np.median(np.diff(one.time)))))
    groups = ({name: values[::step] for name, values in group.items()} for group in one[1:])
    return _Series(one.time[::step], *groups)


def _noise(series: Sequence[Array]) -> float:
    """Return the standard deviation of white noise by third differences, which a smooth motion hardly has."""
    steps = np.concatenate([np.diff(one, 3) for one in series])
    return max(float(np.median(np.abs(steps)) / 0.6745 / np.sqrt(20)), _LEAST_NOISE)


def _parts(count: int, least: int) -> list[tuple[int, int]]:
    """Return the ends of parts of even length."""
    ends = np.linspace(0, count, max(1, least) + 1).astype(int).tolist()
    return list(pairwise(ends))
