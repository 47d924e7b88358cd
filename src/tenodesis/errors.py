"""The exceptions: each states in a sentence what is wrong, and carries key, value and what is allowed."""

from typing import Any

__all__ = [
    "ArgumentError",
    "CommandError",
    "CommandInterruptedError",
    "DesignError",
    "DeviceError",
    "Error",
    "FaultWarning",
    "IdentificationError",
    "InstrumentError",
    "LiveError",
    "MissingExtraError",
    "NoSolutionError",
    "ProtocolError",
    "RecordingError",
    "ReportError",
    "StudyError",
]


class Error(Exception):
    """Base of all exceptions of this package that a user can correct.

    Parameters
    ----------
    problem
        The sentence, or what is wrong with the value of `key`.
    key
        Name of the argument, option or key of a file that is wrong, empty if it is none.
    value
        What it is.
    allowed
        What it must be, as the end of a sentence: "a time above 0 s", "one of yaw and pitch".
    """

    def __init__(self, problem: str = "", *, key: str = "", value: object = None, allowed: str = "") -> None:
        super().__init__(problem or (f"{key} is {value!r}; it must be {allowed}." if key else ""))
        self.key, self.value, self.allowed = key, value, allowed

    def __str__(self) -> str:
        """Return the sentence that names key, value and what is allowed."""
        return str(self.args[0])


class ArgumentError(Error, ValueError):
    """An argument of a function has a value that it must not have."""


class InstrumentError(Error, ValueError):
    """An instrument file or a changed instrument is not valid; the message names key, value and what is allowed."""


class NoSolutionError(Error, ValueError):
    """The instrument has no solution at a single given point; in arrays such points are NaN instead."""


class RecordingError(Error):
    """A recording cannot be written or read; the message names the file, the cause and what remains readable."""


class ProtocolError(Error, ValueError):
    """A protocol is not valid, or an instrument cannot run it; the message names phase, key and what is allowed."""


class DesignError(Error, ValueError):
    """A catalogue is not valid, or there is no scale model within the constraints; the message states why."""


class StudyError(Error, ValueError):
    """A tolerance study cannot be carried out; the message states why."""


class IdentificationError(Error, ValueError):
    """Measured data cannot be used, or do not determine the requested parameters; the message states why."""


class DeviceError(Error):
    """A device cannot be opened, or has failed; the message states what to do."""


class LiveError(Error):
    """The live instrument cannot carry out a command; the message states why."""


class ReportError(Error):
    """A report cannot be written; the message names the folder and the cause."""


class CommandError(Error):
    """A command is given options that exclude each other; the message names them."""


class CommandInterruptedError(CommandError):
    """The user interrupted a command; the message states what is written."""


class FaultWarning(UserWarning):
    """A controller faulted in a run; the message names the faults, and when."""


class MissingExtraError(Error, ImportError):
    """An optional dependency cannot be imported; the message names the extra that installs it.

    Parameters
    ----------
    module
        The module.
    extra
        Name of the extra that installs it.
    cause
        Why it cannot be imported although it is installed.
    """

    def __init__(self, module: str, extra: str, cause: str = "") -> None:
        problem = f"cannot be imported ({cause})" if cause else "is not installed"
        super().__init__(
            f"{module} {problem}: pip install 'tenodesis[{extra}]'.",
            key="module",
            value=module,
            allowed=f"installed with the extra [{extra}]",
        )
        self.extra = extra
        self._cause = cause

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.value, self.extra, self._cause)


def __dir__() -> list[str]:
    return sorted(__all__)
