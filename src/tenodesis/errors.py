"""What the package raises when it is asked for something it cannot give."""


class InstrumentError(ValueError):
    """An instrument file or a changed instrument is not valid; the message names key, value and what is allowed."""


class NoSolutionError(ValueError):
    """The instrument has no solution at a single point asked for; in arrays such points are NaN instead."""


class RecordingError(Exception):
    """A recording cannot be written or read; the message names the file, the cause and what remains readable."""


class ProtocolError(ValueError):
    """A protocol is not valid, or an instrument cannot run it; the message names phase, key and what is allowed."""


class DesignError(ValueError):
    """A catalogue is not valid, or there is no scale model within the constraints; the message says why."""


class StudyError(ValueError):
    """A tolerance study cannot be carried out; the message says why."""


class IdentificationError(ValueError):
    """Measured data cannot be used, or do not tell what is asked of them; the message says why."""


class DeviceError(Exception):
    """A device cannot be opened, or has stopped doing what it is for; the message says what to do."""


class LiveError(Exception):
    """The live instrument does not do what is asked of it; the message says why."""
