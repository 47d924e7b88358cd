"""The C++ core over arrays; the package's modules are its interface."""

from collections.abc import Sequence
import enum
from typing import Annotated

import numpy
from numpy.typing import NDArray
from numpy.typing import NDArray


VERSION: str = '0.1.0'

class Status(enum.IntEnum):
    """How a solve ended."""

    OK = 0
    """solved"""

    NO_EQUILIBRIUM = 1
    """loaded past the fold: the joint snaps through"""

    UNREACHABLE = 2
    """outside the mechanism's range"""

    BOTH_SLACK = 3
    """neither tendon holds the joint"""

    NO_AUTHORITY = 4
    """no stroke of the acting motors restores the angle"""

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
    """One axis of an instrument, in SI units."""

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

def tension_from_current(current: float, tension_per_current: float, range: float) -> float:
    """Tension that a motor's current (A) stands for, N."""

def joint_chord(mechanism: int, chord: float, angle: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]:
    """
    Chord of a joint at angles (rad) by that of the straight joint, m, and its rate by the angle, m/rad: two rows.
    """

def joint_coordinate(mechanism: Sequence[int], angle: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]:
    """
    Coordinates of joints at their angles (rad), in which tendon excursion is linear, and their rates by them.
    """

def joint_straight_chord(mechanism: int, radius: float, backbone_length: float) -> float:
    """Chord of a straight joint, m."""

def joint_excursion(mechanism: int, distance: float) -> float:
    """
    Tendon drawn by a unit of the coordinate at a distance (m) from the joint's middle plane, m.
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

def transmission_parameters() -> list[str]:
    """Names of a transmission's parameters, in their order."""

def far_end(values: NDArray[numpy.float64], angle: NDArray[numpy.float64], signal: NDArray[numpy.float64], time_step: float, out: NDArray[numpy.float64]) -> None:
    """
    Write angle and torque of the far end of a transmission, how far friction may hide each, and its near torque.
    """

class WristSpec:
    pass

class Wrist(WristSpec):
    def __init__(self, mechanism: Sequence[int], parent: Sequence[int], numbers: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], arm: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], tendon: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], motor: Sequence[int], handle: Sequence[int], handle_arm: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)]) -> None: ...

    def solve(self, handle: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], stroke: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], wrench: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], grip: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], in_stem_axes: bool, angle: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')], tension: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')], status: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], threads: int) -> None: ...

    def answer(self, handle: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], stroke: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], wrench: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], grip: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], in_stem_axes: bool, out: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu')], status: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], threads: int) -> None: ...

    def handle_angles(self, angle: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], stroke: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], wrench: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], grip: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], in_stem_axes: bool, out: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')], status: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], threads: int) -> None: ...

    def compensation_strokes(self, handle: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], stroke: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], wrench: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], grip: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], in_stem_axes: bool, out: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')], status: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], threads: int) -> None: ...

    def load_matrix(self, angle: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu')]) -> None: ...

    def closed_form(self, handle_length: float, handle_range: float) -> Spec | None: ...

class WristTwin:
    """The twin of a wrist, with its state."""

    def __init__(self, wrist: WristSpec, passages: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu', writable=False)], contacts: Sequence[int], segments: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], links: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], load_cells: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], rig: Sequence[float], parameters: Sequence[float], law: int, steps_per_sample: int, quasi_static: bool, currents: bool, seed: int) -> None:
        """
        passages: by tendon and contact the joint (-1: the sheath; the handle's count on), friction coefficient, wrap in rad of the straight joint or in the sheath, share, arm in m; links: by joint mass, its centre, inertia about x, y, z, damping, stop, its stiffness, reach of the tip; load_cells: gain, bias, noise, range and resolution by tendon; rig: wrench on the tip by a newton of weight; law: 0 capstan with a constant part, 1 Stribeck, 2 power.
        """

    def copy(self) -> WristTwin: ...

    def run(self, commands: NDArray[numpy.float64], out: NDArray[numpy.float64], energy: NDArray[numpy.float64] | None) -> tuple[int, Status]:
        """
        Step over rows of commands; a row of signals per step in out, totals in energy. Returns the steps taken and the last status.
        """

    def run_controlled(self, controller: Controller, axes: Sequence[Sequence[int]], commands: NDArray[numpy.float64], steps_per_tick: int, time_step: float, relay: float, started: int, requests: NDArray[numpy.uint8] | None, values: NDArray[numpy.float64] | None, modes: NDArray[numpy.uint8] | None, out: NDArray[numpy.float64], control: NDArray[numpy.float64]) -> tuple[int, Status]:
        """
        The same with a controller in the loop; axes: joint of the handle, agonist and antagonist of each; values and modes: what is injected, by axis, step and point; control: the controller's signals by step and axis.
        """

    @property
    def state(self) -> bytes:
        """The state, as bytes."""

    @state.setter
    def state(self, arg: bytes, /) -> None: ...

    @property
    def commands(self) -> list[tuple[str, int]]:
        """Names and widths of a command's columns."""

    @property
    def signals(self) -> list[tuple[str, int]]:
        """Names and widths of the signals that a step writes."""

    def now(self, out: NDArray[numpy.float64]) -> None:
        """Write the signals as they stand."""

    def handle_wanted(self, joint: int) -> float:
        """Angle of a joint of the handle by the last command, rad."""

    def contact(self, joint: int) -> tuple[float, float, float]:
        """
        Tissue across the tip's path about a joint by the last command: angle in rad, N/m, N s/m.
        """

def run_wrist_twins(twins: Sequence[WristTwin], commands: NDArray[numpy.float64], every: int, out: NDArray[numpy.float64], controllers: Sequence[Controller], axes: Sequence[Sequence[int]], steps_per_tick: int, time_step: float, control: NDArray[numpy.float64] | None, threads: int, most_lanes: int = 8) -> list[tuple[int, Status]]:
    """
    Step twins over their commands by run, step and column, or over common ones, at most so many in a vector's lanes, and keep the signals of every n-th step by run, sample and column, those of their controllers by run, sample and axis. Returns steps taken and the last status of each.
    """

def wrist_inertia(wrist: WristSpec, links: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], angles: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], speeds: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], matrix: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu')], bias: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')]) -> None: ...

def wrist_twin_parameters() -> list[str]: ...

def wrist_energies() -> list[str]: ...

class TwinSpec:
    """A twin of one axis, in SI units."""

    def __init__(self, axis: Spec, row: Sequence[float], speed_dependent: bool, tension_dependent: bool, sheath_contacts: int, vertices_per_joint: int, steps_per_sample: int, quasi_static: bool, currents: bool = False) -> None: ...

class Twin:
    """The digital twin of one axis, with its state."""

    def __init__(self, spec: TwinSpec, seed: int) -> None: ...

    def run(self, commands: NDArray[numpy.float64], out: NDArray[numpy.float64]) -> tuple[int, Status]:
        """
        Step over rows of commands; a row of signals per step in out. Returns the steps taken and the last status.
        """

    def audit(self, commands: NDArray[numpy.float64]) -> tuple[int, Status, list[float], float, float, int]:
        """
        Step over rows of commands: steps, status, energies in J (stored before and after, handle, spools, load, friction, damping, tissue), least friction loss of a step, worst residual, most sweeps.
        """

    @property
    def state(self) -> bytes:
        """The state, as bytes."""

    @state.setter
    def state(self, arg: bytes, /) -> None: ...

    @property
    def handle_wanted(self) -> float:
        """Handle angle of the last command, rad."""

    @property
    def contact(self) -> tuple[float, float, float]:
        """
        Tissue by the last command: angle in rad, stiffness in N/m, damping in N s/m.
        """

    def signals(self, command: NDArray[numpy.float64]) -> list[float]:
        """The signals as they stand."""

class TwinBatch:
    """Many twins of one axis each, with their states, stepped together."""

    def __init__(self, spec: TwinSpec, parameters: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], seeds: Annotated[NDArray[numpy.uint64], dict(shape=(None,), order='C', device='cpu', writable=False)], most_lanes: int = 8) -> None:
        """
        One twin per row of parameters (a twin's, then its axis's), at rest; at most so many in a vector's lanes.
        """

    def restart(self, which: NDArray[numpy.int64], parameters: NDArray[numpy.float64], seeds: NDArray[numpy.uint64]) -> None:
        """Put some of them to rest, with new parameters and seeds."""

    @property
    def together(self) -> int:
        """How many step in lockstep, in the lanes of a vector."""

    def advance(self, commands: NDArray[numpy.float64], signals: Sequence[int], every: int, out: NDArray[numpy.float64], outcome: NDArray[numpy.int64], threads: int, controllers: Sequence[Controller], steps_per_tick: int, time_step: float) -> None:
        """
        Step over commands by twin, step and column, or common ones, with a controller each if there are any; write every n-th step's signals, the controllers' counted on after the twins', by twin, signal and sample; outcome: steps taken and status of each. A twin that could not take a step stands still until its restart.
        """

def twin_parameters() -> list[str]:
    """Names of a twin's parameters, in their order."""

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

def twin_gradient(spec: TwinSpec, commands: NDArray[numpy.float64], as_read: bool, variables: Sequence[int], out: NDArray[numpy.float64]) -> tuple[int, Status]:
    """
    Write the expected readings of handle encoder, output encoder and both load cells, and their derivatives by parameters of twin and then axis, by reading, 1 + variable and step. Returns the steps taken and the last status.
    """

class Controller:
    """The controller of an instrument, with its state."""

    def __init__(self, joint_type: int, observer: int, law: int, actuation: int, safe_state: int, own_clock: bool, homed: bool, common: Sequence[float], axes: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], limits: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu', writable=False)], single_precision: bool) -> None: ...

    def step(self, time: int, request: int, measured: NDArray[numpy.float64]) -> tuple[NDArray[numpy.float64], list[int], int, bool, bool, int, int, bool]:
        """
        One tick, time in ns: control signals and faults by axis; state, homed, homing, faults, first faults, cut_power.
        """

    def reset(self) -> None:
        """Return to the initial state."""

    def ask(self, request: int) -> None:
        """Make a request with the next tick of a closed loop."""

    def watchdog(self, since_last_step: float) -> bool:
        """Whether the motors must stop after so many seconds without a tick."""

    def parameters(self) -> bytes:
        """Its parameters as a board takes them: a tenodesis_parameters in float."""

    def counts(self, axis: int) -> tuple[list[int], list[int], int]:
        """
        How often each fault was confirmed, bad samples of each sensor, number of late ticks.
        """

    def records(self) -> tuple[NDArray[numpy.float64], int]:
        """
        The flight recorder, by record: time, state, faults, then per axis measurement, sent velocities, output angle; and the row of the fault's first tick, -1 without one.
        """

INTERFACE_VERSION: int = 3

UNKNOWN_DRIVE_FRICTION: float = 0.15

SPOOL_JUMP_UNIT: str = 'rad/s'

def control_parameters() -> list[tuple[str, str, str]]:
    """Name, unit and meaning of the parameters that all axes share."""

def control_axis_parameters() -> list[tuple[str, str, str]]:
    """Name, unit and meaning of an axis's parameters."""

def homing_reasons() -> list[tuple[str, str]]:
    """Name and meaning of each reason for which homing fails, by number."""

def faults() -> list[tuple[str, str, str]]:
    """
    Name, unit of the threshold and meaning of each fault, in the order of their bits.
    """

def control_signals() -> list[str]:
    """Names of the signals that a controller adds to a run."""

def fault_injection_points() -> list[str]:
    """
    Points between instrument and controller where a fault can be injected.
    """

def run_controlled(twins: Sequence[Twin], controller: Controller, commands: NDArray[numpy.float64], steps_per_tick: int, time_step: float, relay: float, started: int, requests: NDArray[numpy.uint8] | None, values: NDArray[numpy.float64] | None, modes: NDArray[numpy.uint8] | None, out: NDArray[numpy.float64], control: NDArray[numpy.float64]) -> tuple[int, Status]:
    """
    Step twins and a controller in a closed loop over rows of commands, axis by axis. Returns the steps taken and the status of the last.
    """

class LoopProblem(enum.IntEnum):
    """Why the live loop stopped the motors, or refused an order."""

    NONE = 0

    TIP_LOST = 1
    """the load was more than the tip can hold, and was not applied"""

    LATE = 2
    """a tick came later than the bound"""

    NO_MEASUREMENT = 3
    """no measurement for longer than the bound"""

    OPERATOR_GONE = 4
    """the operator's lease ran out"""

    IN_TISSUE = 5
    """the tip is where tissue is to be"""

    OVERLOAD = 6
    """a motor without a controller was to wind a tendon beyond the limit"""

    NOT_A_NUMBER = 7
    """a sensor of such a motor had no value"""

class Order(enum.IntEnum):
    """What the live loop can be ordered to do."""

    REQUEST = 0
    """a: a request to the controller"""

    LAW = 1
    """a: law, b: actuation"""

    HAND = 2
    """at: joint of the handle; value: its angle, rad"""

    LOAD = 3
    """at: column of a row of commands; value"""

    MOTOR = 4
    """at: tendon that no controller commands; value: angle of its spool, rad"""

    SPEED = 5
    """value: simulated over real time; 0: as fast as possible"""

    INJECT_FAULT = 6
    """a: point, b: mode, at: axis, value, ticks: for how long"""

    DROP = 7
    """the rest of a played motion"""

class LiveDevice:
    """What the live loop reads and writes, in named columns."""

    @property
    def commands(self) -> list[tuple[str, int]]:
        """Names and widths of a command's columns."""

    @property
    def signals(self) -> list[tuple[str, int]]:
        """Names and widths of the signals' columns."""

class AxesDevice(LiveDevice):
    """The twins of axes that do not act on each other."""

    def __init__(self, twins: Sequence[Twin], time_step: float, steps_per_tick: int) -> None: ...

class ChainDevice(LiveDevice):
    """The twin of joints that may share tendons."""

    def __init__(self, twin: object, time_step: float, steps_per_tick: int) -> None: ...

class MotorSwitch(Controller):
    """In place of a controller where no joint has a law."""

    def __init__(self) -> None: ...

class MailboxDevice(LiveDevice):
    """A device that another thread serves."""

    def __init__(self, joints: int, handles: int, tendons: int, distal_encoder: bool) -> None: ...

    def post(self, time: int, handle_angle: Sequence[float], tension: Sequence[float], spool_angle: Sequence[float], output_angle: Sequence[float]) -> None:
        """Post a measurement: its time in ns, and its values by joint or tendon."""

    def take(self, timeout: float) -> tuple[bool, list[float]]:
        """
        Whether an answer to the last post came within so many seconds, and its spool velocities by tendon.
        """

    @property
    def power_cut(self) -> bool:
        """Whether a motor does not obey, and all must lose their supply."""

    @property
    def stopped(self) -> bool:
        """Whether the loop has ended."""

class Runtime:
    """The live loop, a thread of its own."""

    def __init__(self, device: LiveDevice, controller: Controller, axes: Sequence[Sequence[int]], motors: Sequence[int], ring: str, ring_capacity: int, handle_range: Sequence[float], period: float, speed: float, late_bound: float, motor_speed: float, motor_tension: float, real_time: bool) -> None:
        """
        axes: joint of the handle, agonist and antagonist of each of the controller's; motors: tendons without a controller.
        """

    def start(self) -> None:
        """Begin."""

    def finish(self) -> None:
        """End, motors at rest."""

    def run_ticks(self, count: int) -> None:
        """Take so many ticks as fast as possible, on this thread."""

    def order(self, kind: int, a: int = 0, b: int = 0, at: int = 0, value: float = 0.0, ticks: int = 0) -> bool:
        """
        Give an order, by number of its kind; false where too many orders wait already.
        """

    def play(self, rows: NDArray[numpy.float64]) -> int:
        """
        Queue ticks of a motion, rows of the device's commands; returns how many were taken.
        """

    def lease(self, seconds: float) -> None:
        """The operator is present for so many seconds more; 0: is absent."""

    def stop(self) -> None:
        """Motors to zero with the next tick, until a request releases them."""

    def forget_timing(self) -> None:
        """Reset the timing with the next tick."""

    @property
    def pending_rows(self) -> int:
        """Ticks of a motion that are still to be played."""

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
    def problem(self) -> LoopProblem:
        """The first problem since the motors were released."""

    @property
    def refused(self) -> list[str]: ...

    @property
    def compute(self) -> tuple[float, float, float, int]:
        """
        Time of a tick: median, 99th percentile, worst, s, and number of ticks.
        """

    @property
    def control(self) -> tuple[float, float, float, int]:
        """The same of the controller alone."""

    @property
    def lateness(self) -> tuple[float, float, float, int]:
        """The same of the delay with which ticks began."""

class RingReader:
    """Reads a live loop's records, from any process."""

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
        """Number of records written so far."""

    @property
    def silence(self) -> float:
        """Time since the loop last reported that it is alive, s."""

def tick_columns() -> list[str]:
    """Columns of a record before its commands."""

class LinkProblem(enum.IntEnum):
    """What has gone wrong with a board."""

    NONE = 0

    LINK_LOST = 1
    """no answer in time"""

    LINK_CLOSED = 2
    """the other end of the line was closed"""

    DAMAGED_FRAMES = 3
    """too many in a row"""

    STALE_ANSWERS = 4
    """only answers to earlier questions"""

    WRONG_VERSION = 5
    """another version of the protocol, or of the C interface"""

    BOARD_RESTARTED = 6
    """the board does not know the session"""

    REFUSED = 7
    """the board refused a question"""

    WRONG_TICK = 8
    """the answer is another tick's"""

    BAD_ANSWER = 9
    """of a wrong size, or with an unknown state"""

    NOT_A_NUMBER = 10
    """a velocity is not a number"""

    BEYOND_LIMIT = 11
    """a velocity is above the instrument's speed limit"""

class BoardController(Controller):
    """A controller on a board behind a line of bytes."""

    def reset(self) -> None:
        """Return to the initial state; sets the link up again where it was lost."""

    def close(self) -> None:
        """Stop the board and close the line."""

    def problem(self) -> tuple[LinkProblem, str]:
        """The link's problem and its description."""

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
    """A board that is sent a measurement per tick."""

    def __init__(self, descriptor: int, parameters: bytes, timeout: float, connect_timeout: float, repetitions: int, silence: int) -> None: ...

class StreamedController(BoardController):
    """A board that measures by itself and sends its ticks."""

    def __init__(self, descriptor: int, parameters: bytes, timeout: float, connect_timeout: float, repetitions: int, silence: int) -> None: ...

class StreamedDevice(LiveDevice):
    """Sensors and motors of such a board."""

    def __init__(self, board: StreamedController) -> None: ...

    def read(self, timeout: float) -> tuple[int, Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]] | None:
        """
        Its next tick, without a loop: time in ns; per axis handle angle, tensions, spool angles.
        """

    def rest(self) -> None:
        """Have the motors rest, and keep the board streaming."""

    def overtaken(self) -> int:
        """Ticks that were lost before the last."""

def tension_scale(spec: Spec) -> float:
    """Tension that stretches a tendon by the distal radius, N."""

def findings() -> list[str]:
    """Names of the findings of a scale model, in their order."""

class SimilarityTarget:
    """An instrument, and the points at which its scale models are evaluated."""

    def __init__(self, spec: Spec, handle_angle: Sequence[float], force: Sequence[float], at_angle: float, stop: float) -> None: ...

    def judge(self, rows: NDArray[numpy.float64], pretension: NDArray[numpy.float64], out: NDArray[numpy.float64], threads: int) -> None:
        """
        Write the findings of every row of parameters, by row and finding; NaN scales the pretension.
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

    OTHER_JOINTS = 4
    """not one or two joints, across the stem and each other"""

class Chain:
    """The kinematic chain, with the routes of its tendons; lengths in m."""

    def __init__(self, tip: tuple[Sequence[int], Sequence[int], Sequence[Sequence[float]]], handle: tuple[Sequence[int], Sequence[int], Sequence[Sequence[float]]], stem_length: float, routes: Sequence[Sequence[tuple[bool, int, float, float, float]]]) -> None:
        """
        Joints from the stem outward: mechanisms, parents, and rows of axis, offset, straight chord, length beyond. Routes of tendons: whether a joint is at the tip, its place there, the tendon's offset from its middle.
        """

    @property
    def line_lengths(self) -> list[int]:
        """Points of every tendon and of every backbone, tip first."""

def joint_lengths(spec: Spec) -> tuple[float, float]:
    """Lengths of the straight joints, distal and proximal, m."""

def chain_frames(chain: Chain, rows: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu')], threads: int) -> None:
    """
    Write the frames of all bodies: stem; carrier, far, end-effector and end of the tip's joints; carrier, far and grip of the handle's.
    """

def chain_jacobian(chain: Chain, rows: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], ends: Sequence[int], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None, None), order='C', device='cpu')], threads: int) -> None:
    """Write the Jacobians of the ends beyond joints of the tip."""

def chain_inverse(chain: Chain, goals: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], start: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')], reach: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], threads: int) -> None:
    """
    Write the coordinates that bring the tip to its goals, and how each solve ended; start: spin, and pan and tilt to start from, NaN for none.
    """

def chain_lines(chain: Chain, rows: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu')]) -> None:
    """Write the points of all tendons and backbones."""
