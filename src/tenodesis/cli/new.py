"""The command that writes an instrument file from a mechanism and a few numbers: ``tenodesis new``."""

import math
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

import typer

from tenodesis import instrument, plant, statics
from tenodesis.cli.command import command
from tenodesis.cli.common import check_choice, note, quantity, say, warn
from tenodesis.cli.outputs import Outputs, write_text
from tenodesis.control.plausibility import implausible, solid_tip_inertia
from tenodesis.errors import CommandError, InstrumentError, NoSolutionError
from tenodesis.instrument import JOINT_TYPES, ShortForm
from tenodesis.instrument.template import ASSUMED, QUESTIONS, RODS, ROPES, Question, sketch, text
from tenodesis.units import Force, Length, PositiveForce, annotation, quantity_of

Given: TypeAlias = str | None

_MECHANISMS = {name: name for name in JOINT_TYPES} | {"gear": "tendon-gear", "pulley": "tendon-pulley"}
_LOADS = ("0.5 N", "1 N", "2 N")
_STEP = 5  # deg
_WIDEST = 90  # deg
_SPARE = 1.25  # of the handle's range over what bends the unloaded tip through its working range
_OFF_STOP = 0.98  # of the output angle at the stop
_HOLLOW = 0.5  # of a rod of steel, which an end-effector is not quite
_OVER_LEAST = 25.0  # of the inertia: then steps of 2 ms, as identification plans them, follow the tip with a margin
_CELLS = (50, 100, 200, 500, 1000, 2000, 5000, 10000)  # N
_CELL_OVER_PRETENSION = 5
_RIGIDITY = "backbone_rigidity"
_HANDLE = 120  # mm
_HANDLE_SHARE = 0.24  # of the overall length


def _option(what: str) -> Any:
    return typer.Option(help=what)


@command()
def new(  # noqa: PLR0917
    outputs: Outputs,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the instrument; the file is NAME.toml.")],
    mechanism: Annotated[Given, _option("tendon-gear, tendon-pulley or continuum.")] = None,
    distal_radius: Annotated[Given, _option("Radius of the gears or the pulley at the tip; a tendon's offset.")] = None,
    proximal_radius: Annotated[Given, _option("Radius of the gears or the pulley at the handle.")] = None,
    backbone_length: Annotated[Given, _option("Length of a continuum's backbone.")] = None,
    backbone_rigidity: Annotated[
        Given,
        _option(f"Flexural rigidity E I of a continuum's backbone, or its rod, '0.6 mm nitinol': {', '.join(RODS)}."),
    ] = None,
    end_effector_length: Annotated[Given, _option("From the joint's moving part to the force at the tip.")] = None,
    overall_length: Annotated[Given, _option("Overall length, hand to tip; also the tendons' length.")] = None,
    tendon_diameter: Annotated[Given, _option("Diameter of the rope.")] = None,
    pretension: Annotated[Given, _option("Tension of either tendon at rest.")] = None,
    rope: Annotated[str, typer.Option(help=f"Kind of rope: {', '.join(ROPES)}.")] = "steel",
    load: Annotated[
        list[str] | None, typer.Option(help="Load at the tip, repeatable. Default: 0.5 N, 1 N and 2 N.")
    ] = None,
    stem_diameter: Annotated[Given, _option("Outer diameter of the stem. Default: around the distal radius.")] = None,
    handle_length: Annotated[
        Given, _option("From the joint's moving part to the hand. Default: 120 mm at most.")
    ] = None,
    output_range: Annotated[Given, _option("Working range of the tip to either side. Default: 80 deg.")] = None,
    handle_range: Annotated[
        Given, _option("Largest handle angle to either side. Default: what the tip needs and a quarter more.")
    ] = None,
    defaults: Annotated[bool, typer.Option("--defaults", help="Ask nothing: what is not given is assumed.")] = False,
) -> None:
    """Write a commented instrument file from a mechanism and six numbers, asking for what no option gives."""
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    if path.stem == ".toml" or not path.parent.is_dir():
        raise CommandError(key="NAME", value=name, allowed="the name of an instrument, in a folder that exists")
    check_choice("--rope", rope.lower(), ROPES)
    given = {
        "distal-radius": distal_radius,
        "proximal-radius": proximal_radius,
        "backbone-length": backbone_length,
        "backbone-rigidity": backbone_rigidity,
        "end-effector-length": end_effector_length,
        "overall-length": overall_length,
        "tendon-diameter": tendon_diameter,
        "pretension": pretension,
    }
    more = {
        "stem_diameter": stem_diameter,
        "handle_length": handle_length,
        "output_range": output_range,
        "handle_range": handle_range,
    }
    with outputs.files(NAME=path):
        joint_type = _mechanism(mechanism, defaults)
        answers = _answers(joint_type, given, defaults)
        for key, value in more.items():
            if value is not None:
                _check(f"--{key.replace('_', '-')}", joint_type, key, value)
        for force in load or ():
            quantity("--load", force, PositiveForce)

        def drafted() -> tuple[_Draft, ShortForm]:
            draft = _Draft(path.stem, joint_type, {}, {})
            for key, answer in answers.items():
                draft.put(key, answer.text, answer.source if answer.given else f"{ASSUMED}, as offered")
            for key, value in more.items():
                if value is not None:
                    draft.put(key, value)
            if load:
                draft.put("conditions.forces", tuple(load))
            return draft, _complete(draft, ROPES[rope.lower()], rope.lower())

        asked = [one for one in QUESTIONS[joint_type] if not defaults and given[one.option] is None]
        _ask_again(joint_type, asked, answers, drafted)
        own = {one.key: one.option for one in QUESTIONS[joint_type]}
        own |= {key: key.replace("_", "-") for key, value in more.items() if value is not None}
        own |= {"conditions.forces": "load"} if load else {}
        try:
            draft, inst = drafted()
        except InstrumentError as problem:
            raise _named(problem, own, [key for key in own if key not in answers or answers[key].given]) from None
        write_text(path, draft.text())
    assumed = sum(source.startswith(ASSUMED) for source in draft.sources.values())
    say(f"{path}: {inst.name}, {joint_type}; yours: {len(draft.sources) - assumed} values, assumed: {assumed}.")
    for one in implausible(inst):
        warn(one.sentence)
    file = shlex.quote(str(path))
    if joint_type == "continuum":
        note(
            "Its backbone bends in one plane for each pair of tendons. One that bends in space is a list of [[joints]] "
            "and [[tendons]], which cad does not take."
        )
    note(f"Next: tenodesis check {file}, tenodesis loss {file}, tenodesis bench {file}")


def _named(problem: InstrumentError, options: Mapping[str, str], given: Iterable[str]) -> CommandError:
    """Return the refusal of an instrument with the option of the number refused, or the options that lead to it."""
    if problem.key in options:
        option = f"--{options[problem.key]}"
        return CommandError(f"{option}: {problem}", key=option, value=problem.value, allowed=problem.allowed)
    led = ", ".join(f"--{options[key]}" for key in options if key in given)
    return CommandError(
        f"{problem} No option gave that value; it follows from {led or 'what is assumed'}.",
        key=problem.key,
        value=problem.value,
        allowed=problem.allowed,
    )


class _Answer(NamedTuple):
    """A value as text with its unit, whether somebody gave it, and its source if that is more than being given."""

    text: str
    given: bool
    source: str = ""


class _Draft(NamedTuple):
    """An instrument file while it is put together; keys are in the order of the file."""

    name: str
    joint_type: str
    values: dict[str, str | tuple[str, ...]]
    sources: dict[str, str]

    def put(self, key: str, value: str | tuple[str, ...], source: str = "") -> None:
        """Put a value in, yours unless it has another source."""
        self.values[key] = value
        self.sources[key] = source or "yours"

    def assume(self, key: str, value: str | tuple[str, ...], reason: str) -> None:
        """Put a value in that nobody gave."""
        if key not in self.values:
            self.put(key, value, f"{ASSUMED}: {reason}")

    def si(self, key: str, kind: Any) -> float:
        """Return a value that was put in, in SI."""
        return quantity(key, str(self.values[key]), kind)

    def text(self) -> str:
        """Return the text of the file."""
        return text(self.name, self.joint_type, self._ordered(self.values), self._ordered(self.sources))

    def _ordered(self, by_key: Mapping[str, Any]) -> dict[str, Any]:
        """Return values in the order of the file: the common ones as the mechanisms have them, then the tables."""
        kind = JOINT_TYPES[self.joint_type]
        order = [field.alias or name for name, field in kind.model_fields.items()]
        own = [one.key for one in QUESTIONS[self.joint_type]]
        order.sort(key=lambda key: own.index(key) if key in own else len(own))
        return {
            key: by_key[key] for key in sorted(by_key, key=lambda key: ("." in key, order.index(key.partition(".")[0])))
        }

    def parse(self) -> ShortForm:
        """Return the instrument as it is so far."""
        return instrument.as_short_form(instrument.parse(self.text(), f"{self.name}.toml"))


def _mechanism(given: Given, defaults: bool) -> str:
    allowed = f"one of {', '.join(JOINT_TYPES)}"
    while True:
        answer = given if given is not None else "tendon-pulley" if defaults else _asked("Mechanism", "tendon-pulley")
        if answer.strip().lower() in _MECHANISMS:
            return _MECHANISMS[answer.strip().lower()]
        problem = CommandError(key="--mechanism", value=answer, allowed=allowed)
        if given is not None:
            raise problem
        say(f"It must be {allowed}.", "yellow")


def _answers(joint_type: str, given: Mapping[str, Given], defaults: bool) -> dict[str, _Answer]:
    """Return the answer to each question of a mechanism by key, asking where no option gives it."""
    questions = QUESTIONS[joint_type]
    foreign = next(
        (option for option, value in given.items() if value is not None and option not in _names(questions)), ""
    )
    if foreign:
        raise CommandError(
            f"--{foreign} is given, which a {joint_type} does not have; leave it out, or give --mechanism continuum.",
            key=f"--{foreign}",
        )
    for one in questions:
        if (value := given[one.option]) is not None:
            _answered(f"--{one.option}", joint_type, one.key, value)
    if not defaults and any(given[one.option] is None for one in questions):
        say(f"\n{sketch(joint_type)}\n\nEnter takes what stands in brackets; a number alone has the unit there.\n")
    found = {}
    for one in questions:
        value = given[one.option]
        if value is not None:
            found[one.key] = _answered(f"--{one.option}", joint_type, one.key, value)
        elif defaults:
            found[one.key] = _Answer(one.default, False)
        else:
            found[one.key] = _ask(joint_type, one)
    return found


def _ask_again(
    joint_type: str,
    asked: Sequence[Question],
    answers: dict[str, _Answer],
    drafted: Callable[[], tuple[_Draft, ShortForm]],
) -> None:
    """Ask once more for each answer that is refused or implausible; Enter keeps it."""
    by_key = {one.key: one for one in asked}
    while by_key:
        try:
            problems = {one.key: one.sentence for one in implausible(drafted()[1])}
        except InstrumentError as problem:
            problems = {problem.key: str(problem)}
        key = next((key for key in by_key if key in problems), None)
        if key is None:
            return
        warn(problems[key])
        question = by_key.pop(key)
        try:
            again = _ask(joint_type, question._replace(default=answers[key].text))
        except CommandError:  # there is nobody to answer
            return
        if again.text != answers[key].text:
            answers[key] = again


def _names(questions: tuple[Question, ...]) -> set[str]:
    return {one.option for one in questions}


def _ask(joint_type: str, question: Question) -> _Answer:
    meaning = JOINT_TYPES[joint_type].model_fields[question.key].description
    unit = question.default.partition(" ")[2]
    rod = ", or its rod, as in 0.6 mm nitinol" if question.key == _RIGIDITY else ""
    while True:
        answer = _asked(f"{meaning}{rod} ({question.key})", question.default, f"--{question.option}").strip()
        if answer == question.default:
            return _Answer(answer, False)
        if _is_number(answer):
            answer = f"{answer} {unit}"
        try:
            return _answered(question.key, joint_type, question.key, answer)
        except CommandError as problem:
            say(str(problem), "yellow")


def _is_number(answer: str) -> bool:
    try:
        float(answer)
    except ValueError:
        return False
    return True


def _asked(prompt: str, default: str, option: str = "--mechanism") -> str:
    """Return a line from the keyboard or from standard input."""
    sys.stdout.write(f"{prompt} [{default}]: ")
    sys.stdout.flush()
    line = sys.stdin.readline()
    if not line:
        say("")
        raise CommandError(
            f"standard input ended before {option} was answered; give {option}, or --defaults to assume the rest.",
            key=option,
        )
    return line.strip() or default


def _answered(option: str, joint_type: str, key: str, value: str) -> _Answer:
    """Return what was given as an answer, a round rod's E I for its diameter and material; refuse what is no value."""
    diameter, _, material = value.strip().rpartition(" ")
    rod = RODS.get(material.lower()) if key == _RIGIDITY else None
    if rod is None:
        try:
            _check(option, joint_type, key, value)
        except CommandError as problem:
            if key != _RIGIDITY:
                raise
            sentence = f'{str(problem).removesuffix(".")}, or a rod like "0.6 mm nitinol", of {", ".join(RODS)}.'
            raise CommandError(sentence, key=option, value=value) from None
        return _Answer(value, True)
    rigidity = rod.modulus * math.pi * quantity(option, diameter, Length) ** 4 / 64
    source = f"yours: a rod of {diameter} of {material}, {rod.modulus / 1e9:g} GPa ({rod.source})"
    return _Answer(f"{1e6 * rigidity:.4g} N*mm^2", True, source)


def _check(option: str, joint_type: str, key: str, value: str) -> None:
    """Refuse text that is no value of a key."""
    kind = quantity_of(JOINT_TYPES[joint_type].model_fields[key])
    assert kind is not None
    quantity(option, value, Annotated[float, *annotation(kind)])


def _complete(draft: _Draft, rope: Any, rope_name: str) -> ShortForm:
    """Assume what was not given, and return the instrument."""
    distal = next(draft.si(key, Length) for key in draft.values if key.startswith("distal_"))
    around = math.ceil(2e3 * (2 * distal + draft.si("tendon_diameter", Length))) / 2
    draft.assume("stem_diameter", f"{around:g} mm", "around the distal radius and a tendon")
    handle = min(_HANDLE, _HANDLE_SHARE * 1e3 * draft.si("overall_length", Length))
    draft.assume("handle_length", f"{handle:.4g} mm", "of a handle for one hand")
    draft.assume("tendon_modulus", rope.modulus, f"{rope_name}, {rope.source}")
    draft.assume("output_range", "80 deg", "typical of articulated instruments")
    draft.assume("conditions.forces", _LOADS, "typical of tissue")
    for key, value, reason in (
        ("law", "capstan", "tendons slide over the joints' vertices and in a sheath"),
        ("vertex_coefficient", "0.1", "steel on steel, lubricated"),
        ("sheath_coefficient", "0.1", "steel on steel, lubricated"),
        ("sheath_bend", "10 deg", "a sheath that is nearly straight"),
    ):
        draft.assume(f"friction.{key}", value, reason)
    draft.assume("drives.spool_radius", "5 mm", "a small spool")
    draft.assume("drives.motor_speed", "1200 deg/s", "at the spool, 0.1 m/s of tendon")
    cell = _cell(draft)
    draft.assume("sensors.load_cell_range", f"{cell:g} N", f"{_CELL_OVER_PRETENSION} pretensions or more")
    _assume_handle_range(draft)
    inst = draft.parse()
    least, rod = _OVER_LEAST * plant.least_tip_inertia(inst), _HOLLOW * solid_tip_inertia(inst)
    reason = "a rod of the stem's diameter, half of steel"
    if rod < least:
        reason = "what can be simulated and identified with a margin; the real one is smaller"
    draft.assume("dynamics.tip_inertia", f"{max(rod, least):.3g} kg*m^2", reason)
    return draft.parse()


def _assume_handle_range(draft: _Draft) -> None:
    """Assume the handle's range: what bends the unloaded tip through its working range, and a quarter more."""
    if "handle_range" in draft.values:
        return
    for degrees in range(_WIDEST, 0, -_STEP):
        draft.values["handle_range"] = f"{degrees} deg"
        try:
            inst = draft.parse()
        except InstrumentError as problem:
            if degrees > _STEP and "handle_range is" in str(problem):
                continue
            raise
        break
    needed = math.degrees(_SPARE * statics.reach(inst))
    try:
        # The unloaded tip stays off its mechanical stop.
        stop = math.degrees(float(statics.handle_angle(inst, _OFF_STOP * inst.output_stop)))
    except NoSolutionError:  # the mechanism cannot bend as far
        stop = degrees
    within = min(_STEP * math.ceil(needed / _STEP), degrees, math.floor(stop))
    del draft.values["handle_range"]
    draft.assume("handle_range", f"{within} deg", "bends the unloaded tip through its working range, with room")


def _cell(draft: _Draft) -> float:
    """Return the smallest usual range of a load cell that suits the pretension, N."""
    need = _CELL_OVER_PRETENSION * draft.si("pretension", Force)
    return next((cell for cell in _CELLS if cell > need), need)
