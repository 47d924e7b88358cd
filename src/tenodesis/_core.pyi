"""The C++ core over arrays; the package's modules are its interface."""

from collections.abc import Sequence
import enum
from typing import Annotated

import numpy
from numpy.typing import NDArray
from numpy.typing import NDArray


class Status(enum.IntEnum):
    """How a solve ended."""

    OK = 0
    """solved"""

    NO_EQUILIBRIUM = 1
    """loaded past the fold: the joint snaps through"""

    UNREACHABLE = 2
    """outside what the mechanism can bend to"""

    BOTH_SLACK = 3
    """neither tendon holds the joint"""

    NO_AUTHORITY = 4
    """no stroke of the acting motors gives the angle back"""

    OUT_OF_RANGE = 5
    """handle angle beyond the handle's range"""

    NOT_FINITE = 6
    """NaN or infinite input"""

class JointType(enum.Enum):
    """Joint mechanism."""

    TENDON_GEAR = 0

    TENDON_PULLEY = 1

    CONTINUUM = 2

class Spec:
    """One axis of an instrument, as numbers in SI units."""

    def __init__(self, joint_type: JointType, parameters: Sequence[float], handle_range: float) -> None: ...

    def __getstate__(self) -> tuple[JointType, list[float], float]: ...

    def __setstate__(self, arg: tuple[JointType, Sequence[float], float], /) -> None: ...

def parameters() -> list[str]:
    """Names of a spec's parameters, in their order."""

def tendon_stiffness(spec: Spec) -> float:
    """Stiffness of one tendon, N/m."""

def unloaded_limit(spec: Spec) -> float:
    """
    Unloaded distal coordinate at the end of the handle's range, as a share of the joint's limit.
    """

def evaluate(spec: Spec, operation: str, inputs: Sequence[NDArray[numpy.float64]], out: NDArray[numpy.float64], status: NDArray[numpy.uint8], threads: int) -> None:
    """
    Write an operation's outputs, by output, 1 and point, and the status of every point.
    """

def gradient(spec: Spec, operation: str, inputs: Sequence[NDArray[numpy.float64]], variables: Sequence[int], out: NDArray[numpy.float64], status: NDArray[numpy.uint8], threads: int) -> None:
    """
    Write the derivatives, by output, variable and point, and the status of every point.
    """

class Tendon:
    """An elastic tendon through contacts with friction, with its state."""

    def __init__(self, stiffness: Sequence[float], exponent: Sequence[float], constant: float, viscous: float, rest_tension: float) -> None: ...

    def run(self, spool: NDArray[numpy.float64], drawn: NDArray[numpy.float64], by_tension: bool, time_step: float, out: NDArray[numpy.float64]) -> int:
        """
        Step over prescribed ends; out: proximal and distal tension, wound length, friction loss, residual. Returns the most sweeps.
        """

    @property
    def tension(self) -> list[float]:
        """Tension of every segment, N."""

    @property
    def slip(self) -> list[float]:
        """Slip past every contact, m."""

def transmit(tension: NDArray[numpy.float64], exponent: float, gain: float, held: float, out: NDArray[numpy.float64]) -> None:
    """
    Write the distal tension of one contact; held: the distal tension before, N.
    """

def play(lower: NDArray[numpy.float64], upper: NDArray[numpy.float64], start: float, source: NDArray[numpy.int64]) -> None:
    """
    Write by which bound a value was pushed last: k + 1 by upper[k], -(k + 1) by lower[k], 0 by none.
    """

class TwinSpec:
    """A twin of one axis, as numbers in SI units."""

    def __init__(self, axis: Spec, row: Sequence[float], speed_dependent: bool, sheath_contacts: int, steps_per_sample: int, quasi_static: bool) -> None: ...

class Twin:
    """The digital twin of one axis, with its state."""

    def __init__(self, spec: TwinSpec, seed: int) -> None: ...

    def run(self, commands: NDArray[numpy.float64], out: NDArray[numpy.float64]) -> tuple[int, Status]:
        """
        Step over rows of commands; a row of signals per step in out. Returns the steps taken and why no more were.
        """

    def audit(self, commands: NDArray[numpy.float64]) -> tuple[int, Status, list[float], float, float, int]:
        """
        Step over rows of commands: steps, status, energies in J (stored before and after, handle, spools, load, friction, damping), least friction loss of a step, worst residual, most sweeps.
        """

    @property
    def state(self) -> bytes:
        """The whole state, as bytes."""

    @state.setter
    def state(self, arg: bytes, /) -> None: ...

    @property
    def handle_wanted(self) -> float:
        """Where the handle was last told to be, rad."""

    def signals(self, command: NDArray[numpy.float64]) -> list[float]:
        """The signals as they stand."""

def twin_parameters() -> list[str]:
    """Names of a twin's numbers, in their order."""

def twin_commands() -> list[str]:
    """Names of a command's columns."""

def twin_signals() -> list[str]:
    """Names of the signals a step writes, in their order."""

def most_sheath_contacts() -> int:
    """How many contacts a twin's sheath can have."""

def rig_arm(spec: Spec) -> float:
    """From a load rig's pivot to the tip of the straight joint, m."""

def joint_shares(spec: Spec) -> tuple[float, float]:
    """
    Shares of a tendon's length that lie in the handle's joint and in the tip's.
    """

def run_many(spec: TwinSpec, parameters: NDArray[numpy.float64], commands: NDArray[numpy.float64], seeds: NDArray[numpy.uint64], signals: Sequence[int], every: int, out: NDArray[numpy.float64], told: NDArray[numpy.int64], threads: int) -> None:
    """
    Run one twin per row of parameters (a twin's, then its axis's); told: steps taken and status of each.
    """

def twin_gradient(spec: TwinSpec, commands: NDArray[numpy.float64], as_read: bool, variables: Sequence[int], out: NDArray[numpy.float64]) -> tuple[int, Status]:
    """
    Write what handle encoder, output encoder and both load cells are expected to read, and the derivatives by numbers of twin and then axis, by reading, 1 + variable and step. Returns the steps taken and why no more.
    """

class Controller:
    """The controller of an instrument, with its state."""

    def __init__(self, joint_type: int, observer: int, law: int, actuation: int, safe_state: int, own_clock: bool, homed: bool, common: Sequence[float], axes: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], limits: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu', writable=False)], single_precision: bool) -> None: ...

    def step(self, time: int, request: int, measured: NDArray[numpy.float64]) -> tuple[list[list[float]], list[int], int, bool, bool, int, int]:
        """
        One tick, time in ns: per axis the control signals and its faults; state, homed, homing, faults, first.
        """

    def reset(self) -> None:
        """As when it was made."""

    def watchdog(self, since_last_step: float) -> bool:
        """Whether the motors must stop, given seconds."""

    def counts(self, axis: int) -> tuple[list[int], list[int], int]:
        """
        How often each fault was confirmed, bad samples per sensor, late ticks.
        """

    def records(self) -> tuple[list[list[float]], int]:
        """
        The flight recorder: time, state, faults, then per axis measurement, sent velocities, output angle; and which row is the fault's first.
        """

def control_parameters() -> list[str]:
    """Names of the numbers that all axes share."""

def control_axis_parameters() -> list[str]:
    """Names of the numbers of an axis."""

def fault_names() -> list[str]:
    """Names of the faults, in the order of their bits."""

def control_signals() -> list[str]:
    """Names of the signals that a controller adds to a run."""

def tamper_places() -> list[str]:
    """Places between twin and controller where a fault can be put."""

def run_controlled(twins: Sequence[Twin], controller: Controller, commands: NDArray[numpy.float64], steps_per_tick: int, time_step: float, started: int, requests: NDArray[numpy.uint8] | None, values: NDArray[numpy.float64] | None, modes: NDArray[numpy.uint8] | None, out: NDArray[numpy.float64], control: NDArray[numpy.float64]) -> tuple[int, Status]:
    """
    Step twins and a controller in one loop over rows of commands, axis by axis; returns steps and why no more.
    """

class LiveDevice:
    """What the live loop reads and writes."""

class TwinDevice(LiveDevice):
    """The twins of an instrument's axes as a device."""

    def __init__(self, twins: Sequence[Twin], time_step: float, steps_per_tick: int) -> None: ...

class MailboxDevice(LiveDevice):
    """A device that another thread serves."""

    def __init__(self, axes: int) -> None: ...

    def post(self, time: int, measured: NDArray[numpy.float64]) -> None:
        """
        Hand over a measurement: its time in ns; per axis handle angle, tensions, spool angles, output angle.
        """

    def take(self, timeout: float) -> tuple[bool, list[list[float]]]:
        """
        The spool velocities that answer the last post, and whether any came in time.
        """

    @property
    def stopped(self) -> bool:
        """Whether the loop has ended."""

class Runtime:
    """The live loop, a thread of its own."""

    def __init__(self, device: LiveDevice, controller: Controller, ring: str, ring_capacity: int, handle_range: Sequence[float], period: float, speed: float, late_bound: float, real_time: bool) -> None: ...

    def start(self) -> None:
        """Begin."""

    def finish(self) -> None:
        """End, motors at rest."""

    def run_ticks(self, count: int) -> None:
        """Take so many ticks as fast as they go, here."""

    def order(self, kind: int, a: int = 0, b: int = 0, axis: int = 0, value: float = 0.0, ticks: int = 0) -> bool:
        """Ask something of it; false where too much is asked already."""

    def tamper_not_a_number(self, place: int, axis: int, ticks: int) -> bool:
        """Make a sensor say no number."""

    def play(self, rows: NDArray[numpy.float64]) -> int:
        """
        Queue ticks of a played motion, per axis handle angle, force, radial force; returns how many were taken.
        """

    def lease(self, seconds: float) -> None:
        """The operator is there for so long; 0: there is none."""

    def stop(self) -> None:
        """Motors to zero with the next tick, until a request sets them free."""

    def forget_timing(self) -> None:
        """Count anew from the next tick on."""

    @property
    def pending_rows(self) -> int: ...

    @property
    def running(self) -> bool: ...

    @property
    def ticks(self) -> int: ...

    @property
    def late(self) -> int: ...

    @property
    def missed(self) -> int: ...

    @property
    def speed(self) -> float: ...

    @property
    def problem(self) -> int: ...

    @property
    def refused(self) -> list[str]: ...

    @property
    def compute(self) -> tuple[float, float, float, int]:
        """Of a tick: p50, p99, worst, s, and how many."""

    @property
    def control(self) -> tuple[float, float, float, int]:
        """Of the controller alone."""

    @property
    def lateness(self) -> tuple[float, float, float, int]:
        """By which ticks began late."""

class RingReader:
    """Reads a loop's records from any process."""

    def __init__(self, path: str) -> None: ...

    def read(self, cursor: int, out: NDArray[numpy.float64]) -> tuple[int, int, int]:
        """
        Copy records from the cursor on; returns how many, the cursor after them, and how many were lost.
        """

    @property
    def columns(self) -> int: ...

    @property
    def capacity(self) -> int: ...

    @property
    def written(self) -> int:
        """Records there have been."""

    @property
    def silence(self) -> float:
        """Time since the loop last said that it lives, s."""

def tick_columns() -> list[str]:
    """Columns of a record before its axes'."""

def bench_columns() -> list[str]:
    """Columns of an axis before its signals."""

class BoardController(Controller):
    """A controller on a board behind a line of bytes."""

    def reset(self) -> None:
        """As when it was made; sets the link up anew where it was lost."""

    def close(self) -> None:
        """Tell the board to stop, and let go of the line."""

    def problem(self) -> tuple[str, str]:
        """
        Name of what has gone wrong with the link, empty where nothing has, and what is known of it.
        """

    def board(self) -> tuple[str, int, int, int, bool]:
        """
        Name, version of protocol and interface, clock in Hz, whether it has sensors.
        """

    def link_counts(self) -> tuple[int, int, int, int, int]:
        """
        Answers, repeated questions, damaged frames, stale answers, frames that the board dropped.
        """

    def busy(self) -> int:
        """Ticks of the board's clock that the tick before the last took."""

    def stopped(self) -> bool:
        """Whether the board has stopped and waits to be enabled."""

class SerialController(BoardController):
    """One that is sent a measurement per tick."""

    def __init__(self, descriptor: int, parameters: bytes, timeout: float, connect_timeout: float, repetitions: int, silence: int) -> None: ...

class StreamedController(BoardController):
    """One that measures by itself and sends its ticks."""

    def __init__(self, descriptor: int, parameters: bytes, timeout: float, connect_timeout: float, repetitions: int, silence: int) -> None: ...

class StreamedDevice(LiveDevice):
    """Sensors and motors of such a board."""

    def __init__(self, board: StreamedController) -> None: ...

    def read(self, timeout: float) -> tuple[int, list[list[float]]] | None:
        """
        Its next tick, without a loop: time in ns; per axis handle angle, tensions, spool angles.
        """

    def rest(self) -> None:
        """Tell the board that motors are to rest, and that somebody listens."""

    def overtaken(self) -> int:
        """Ticks that were lost before the last."""

def tension_scale(spec: Spec) -> float:
    """Tension that stretches a tendon by the distal radius, N."""

def findings() -> list[str]:
    """Names of what is found of a scale model, in their order."""

class SimilarityTarget:
    """An instrument and the points that its scale models are judged at."""

    def __init__(self, spec: Spec, handle_angle: Sequence[float], force: Sequence[float], at_angle: float, stop: float) -> None: ...

    def judge(self, rows: NDArray[numpy.float64], pretension: NDArray[numpy.float64], out: NDArray[numpy.float64], threads: int) -> None:
        """
        Write what is found of every row of parameters, by row and finding; NaN scales the pretension.
        """

class Reach(enum.IntEnum):
    """How an inverse ended."""

    OK = 0
    """solved"""

    UNREACHABLE = 1
    """no posture brings the tip there"""

    SINGULAR = 2
    """two joints turn about one axis there"""

    NOT_FINITE = 3
    """NaN or infinite input"""

class Chain:
    """
    The whole instrument: axes from the stem outward, and lengths between them, m.
    """

    def __init__(self, specs: Sequence[Spec], pitches: Sequence[bool], stem_length: float, joint_spacing: float, handle_joint_spacing: float) -> None: ...

    @property
    def frame_names(self) -> list[str]:
        """Names of the frames, in their order."""

    @property
    def path_length(self) -> int:
        """Points that a tendon is drawn with."""

def joint_lengths(spec: Spec) -> tuple[float, float]:
    """Lengths of the straight joints, distal and proximal, m."""

def chain_frames(chain: Chain, rows: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu')], threads: int) -> None:
    """Write the frames of all bodies."""

def chain_tip(chain: Chain, rows: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')], threads: int) -> None:
    """Write the frame of the tip."""

def chain_jacobian(chain: Chain, rows: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu')], threads: int) -> None:
    """Write the tip's Jacobian."""

def chain_inverse(chain: Chain, goals: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], told: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')], reach: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], threads: int) -> None:
    """
    Write the coordinates that bring the tip to its goals, and how each ended; told are spin and the pan and tilt to start from, NaN for none.
    """

def chain_paths(chain: Chain, rows: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu')]) -> None:
    """Write the points of all tendons."""
