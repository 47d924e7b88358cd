"""What chapters need of an instrument: each a function that says in a sentence what is missing, "" if nothing is."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from tenodesis import control
from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.paper.context import Context

Need: TypeAlias = Callable[[Context], str]

TESTS = Path(__file__).parents[3] / "tests"
"""Where the tests are, in the repository; independent code is with them, and no part of the package."""


def planar(context: Context) -> str:
    """Whether the file has the short form, with a joint_type."""
    return (
        ""
        if context.short is not None
        else "it is for one planar axis: of a file with a joint_type, and of two axes with --axis."
    )


def law(context: Context) -> str:
    """Whether a controller of pairs of tendons compensates a joint."""
    try:
        control.compensated(context.given)
    except (ArgumentError, InstrumentError):
        name = context.given.name
        return (
            f"it is about the law of pairs of tendons, and no joint of {name} has one of its own; tenodesis record "
            "--law joints runs that of all joints."
        )
    return ""


def matrices(context: Context) -> str:
    """Whether there is more than one planar axis, and the report is one's own."""
    several = context.short is None or len(context.short.axes) > 1
    return "" if several and context.is_own else "of a planar axis it is one number, in the chapter on loss."


def listed(context: Context) -> str:
    """Whether the file lists joints and tendons."""
    return "" if context.short is None else "it is for instruments whose file lists joints and tendons."


def scale_model(context: Context) -> str:
    """Whether a scale model was given."""
    return "" if context.scaled is not None else "there is none beside it; --scaled-up names one."


def papers(context: Context) -> str:
    """Whether the instrument is one of the paper's."""
    return "" if not context.is_own else "tenodesis scale designs scale models."


def friction(context: Context) -> str:
    """Whether the file has friction."""
    return "" if context.given.friction.law != "none" else "its file has no friction."


def gears(context: Context) -> str:
    """Whether the joints are rolling gears, for which there is independent code in one plane."""
    return "" if context.inst.joint_type == "tendon-gear" else "independent code is for gear joints."


def peers(_: Context) -> str:
    """Whether the independent code is there."""
    return "" if (TESTS / "peers").is_dir() else "the independent code is with the tests, in the repository."
