"""The twin of a coupled instrument in real time, in a thread of the page's process."""

import threading
import time
from collections import deque
from math import nan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import plant
from tenodesis.console.log import rare_log
from tenodesis.control import Controller, OperatingState
from tenodesis.control.controller import fault_names
from tenodesis.control.pairs import compensated
from tenodesis.devices.device import Capabilities
from tenodesis.errors import ArgumentError, LiveError, NoSolutionError
from tenodesis.instrument import FullForm, ShortForm
from tenodesis.live.commands import ControllerRequest, RestartableConnection
from tenodesis.live.status import RuntimeState, Status, Timing
from tenodesis.run import Array, Run, concatenate
from tenodesis.statics.chain import coordinates
from tenodesis.twin import Held, Twin

_log = rare_log(__name__)
_STEPS = 20
_BLOCK = _STEPS * plant.TIME_STEP
"""Time that the twin is stepped at once, s."""
_BEHIND = 5 * _BLOCK
"""Time that is caught up, s; what is lost beyond is not."""
_LATE = 0.95
"""Share of real time below which the page says so."""
_KEPT = 10.0
"""Time for which rows are kept, one a block, s."""
_HAND_SPEED = 1.5
"""Of handle and driven joints, rad/s."""
_GAIN = 10.0
"""Of the position loop around motors that no controller commands, 1/s."""
_CURVES = ("output_angle", "handle_angle", "spool_angle", "estimated_output_angle")
_STATES: dict[str, RuntimeState] = {
    "enable": RuntimeState.ENABLED,
    "resume": RuntimeState.ENABLED,
    "pause": RuntimeState.PAUSED,
    "disable": RuntimeState.DISABLED,
}


class Asked(NamedTuple):
    """What the operator asks for."""

    angles: Array
    """Of the handle's joints or, without a handle, of the tip's, rad"""
    force: Array
    """On the tip, in its axes, N, (3,)"""
    held: Held | None = None


class CoupledLoop:
    """A twin that runs until closed; :meth:`connect` opens connections to it.

    If the machine is late, the twin slows down. If the twin cannot go on, it stays in its last state until the operator
    asks for something else.
    """

    def __init__(self, inst: FullForm, *, law: str = "robust", actuation: str = "differential", seed: int = 0):
        self.inst, self._seed = inst, seed
        self.driven = inst.handle_joints or inst.tip_joints
        """Joints that the operator moves: the handle's or, without one, those that the motors turn."""
        self.law, self.actuation = law, actuation
        self.operator: str | None = None
        self.lock = threading.RLock()
        self.refused: str | None = None
        """Why no controller compensates this instrument."""
        self._planar: ShortForm | None = None
        try:
            self._planar = compensated(inst)
        except ArgumentError as problem:
            self.refused = str(problem)
        self.begin()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="coupled twin", daemon=True)
        self._thread.start()

    def connect(self, origin: str) -> "CoupledLink":
        """Open a connection in the name of an origin."""
        return CoupledLink(self, origin)

    def close(self) -> None:
        """Stop the twin."""
        self._done.set()
        self._thread.join()

    def begin(self) -> None:
        """Begin with a twin at rest, without load, motors off."""
        self.twin = Twin(self.inst, seed=self._seed)
        self._make_controller(enabled=False)
        # Without a handle the motors do what the operator asks for.
        self._state = RuntimeState.DISABLED if self.inst.handle_joints else RuntimeState.ENABLED
        self._at = np.zeros(len(self.driven))
        self.asked = Asked(self._at, np.zeros(3))
        self.rows: deque[Run] = deque(maxlen=round(_KEPT / _BLOCK))
        self._times: deque[float] = deque(maxlen=100)
        self.problem: str | None = None
        self._advance()

    def choose(self, law: str, actuation: str) -> None:
        """Choose law and actuation; the controller's estimates begin anew."""
        before = self.law, self.actuation
        self.law, self.actuation = law, actuation
        try:
            self._make_controller(enabled=self.state == RuntimeState.ENABLED)
        except ArgumentError:
            self.law, self.actuation = before
            raise

    def request(self, what: ControllerRequest) -> None:
        """Request something of the controller or, without one, of the motors."""
        if self.controller is not None:
            self.controller.ask(what)
        elif self.inst.handle_joints or what not in _STATES:
            raise LiveError(self.refused or f"{what} is for a controller, which this instrument does not have.")
        else:
            self._state = _STATES[what]
            self.asked = self.asked._replace(angles=self._at)

    @property
    def state(self) -> RuntimeState:
        """State of the controller or, without one, of the motors."""
        if self.controller is None:
            return self._state
        return RuntimeState(OperatingState(int(self.rows[-1]["operating_state"].max())).name)

    @property
    def speed(self) -> float:
        """Simulated time over real time in the last second."""
        times = list(self._times)
        return (len(times) - 1) * _BLOCK / (times[-1] - times[0]) if len(times) > 1 else 1.0

    def _make_controller(self, *, enabled: bool) -> None:
        self.controller = (
            None
            if self._planar is None
            else Controller(self._planar, law=self.law, actuation=self.actuation, enabled=enabled)  # type: ignore[arg-type]
        )

    def _run(self) -> None:
        due = time.monotonic()
        while not self._done.is_set():
            with self.lock:
                if self.problem is None:
                    try:
                        self._advance()
                    except Exception:
                        _log.exception("the twin could not go on")
                        self.problem = "The twin failed; the log of the page shows where."
            now = time.monotonic()
            due = max(due + _BLOCK, now - _BEHIND)
            self._done.wait(due - now)

    def _advance(self) -> None:
        """Go on by a block."""
        inst, asked = self.inst, self.asked
        moves = bool(inst.handle_joints) or self._state == RuntimeState.ENABLED
        most = (np.arange(1, _STEPS + 1) * _HAND_SPEED * plant.TIME_STEP)[:, np.newaxis]
        path = self._at + (asked.angles - self._at).clip(-most, most) * moves
        speeds = np.zeros(len(inst.tendons))
        handle = path
        if not inst.handle_joints:
            handle = np.zeros((_STEPS, 0))
            wound = self.rows[-1]["spool_angle"][-1] if self.rows else speeds
            before, after = self._spools(self._at), self._spools(path[-1])
            speeds = ((after - before) / _BLOCK + _GAIN * (after - wound)) * moves
        try:
            run = self.twin.run(
                handle,
                wrench=np.concatenate([asked.force, np.zeros(3)]),
                spool_velocity=speeds,
                held=asked.held,
                controller=self.controller,
            )
        except (ArgumentError, NoSolutionError) as problem:
            reason = str(problem)
            self.problem = f"{reason[0].upper()}{reason[1:]} The twin stays as it was until you ask for something else."
            if self.controller is not None:
                # It has gone on while the twin has not.
                self._make_controller(enabled=self.state == RuntimeState.ENABLED)
                self.problem += " The controller begins anew."
            self._times.clear()
            return
        self._at = path[-1]
        self.rows.append(run.rows(-1))
        self._times.append(time.monotonic())

    def _spools(self, angles: Array) -> Array:
        """Return the spools' angles that hold the joints at angles, tendons unstretched."""
        inst = self.inst
        return np.asarray(inst.tendon_arms("tip") @ coordinates(inst.tip_joints, angles)[0] / spool_radius(inst))


class CoupledLink(RestartableConnection):
    """A connection to a :class:`CoupledLoop` in the name of an origin."""

    def __init__(self, loop: CoupledLoop, origin: str) -> None:
        self.loop, self.origin = loop, origin

    @property
    def inst(self) -> FullForm:
        """The instrument that runs."""
        return self.loop.inst

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the twin; its axes are the joints of the tip."""
        joints = tuple(joint.name for joint in self.inst.tip_joints)
        return Capabilities("twin", joints, 1 / plant.TIME_STEP, False, True, False, 0.0, 0.0)

    def latest(self) -> dict[str, Any]:
        """Return the newest row of the run, and what the operator asks for."""
        with self.loop.lock:
            return {"run": self.loop.rows[-1], "asked": self.loop.asked}

    def history(self, seconds: float, rows: int = 500) -> dict[str, Any]:
        """Return the rows of the last seconds, thinned, with the signals that curves show."""
        with self.loop.lock:
            kept = list(self.loop.rows)[-round(seconds / _BLOCK) :]
            asked = self.loop.asked
        kept = kept[:: -(-len(kept) // rows)]
        # A controller may have begun anew, but none comes or goes.
        return {"run": concatenate(kept), "asked": asked}

    def status(self) -> Status:
        """Return the state of loop and controller."""
        loop = self.loop
        with loop.lock:
            row, speed, problem = loop.rows[-1], loop.speed, loop.problem
            ticks = round(row.time[-1] / plant.TIME_STEP)
            faults = 0 if loop.controller is None else int(row["faults"].max())
            if problem is None and speed < _LATE:
                problem = f"This machine is late: the twin runs at {100 * speed:.0f} % of real time."
            return Status(
                state=loop.state,
                homed=True,
                homing=False,
                stopped=False,
                faults=fault_names(faults),
                first_faults=(),
                law=loop.law,
                actuation=loop.actuation,
                operator=loop.operator,
                timing=Timing(ticks, 0, 0, 0, nan, nan, nan, nan, nan, nan, nan, 1 / plant.TIME_STEP),
                realtime=(),
                protocol=None,
                recording=None,
                recorder_lost=0,
                speed=speed,
                problem=problem,
            )

    def acquire(self, force: bool = False) -> bool:
        """Become the operator; return whether that worked."""
        with self.loop.lock:
            if self.loop.operator not in (None, self.origin) and not force:
                return False
            self.loop.operator = self.origin
        return True

    def release(self) -> None:
        """Stop being the operator; the motors pause."""
        with self.loop.lock:
            if self.loop.operator == self.origin:
                self.loop.operator = None
                self.stop()

    def heartbeat(self) -> bool:
        """Return whether this connection is the operator's."""
        return self.loop.operator == self.origin

    def hand(self, angles: ArrayLike) -> None:
        """Move the handle's joints or, without a handle, the tip's to angles, rad."""
        joints = self.loop.driven
        given = _finite("angles", angles, len(joints))
        for joint, angle in zip(joints, given, strict=True):
            if abs(angle) > joint.range + 1e-9:
                allowed = f"within ±{joint.range:.4g} rad"
                raise LiveError(key=f"angle of {joint.name}", value=float(angle), allowed=allowed)
        self._ask(angles=given)

    def force(self, force: ArrayLike) -> None:
        """Load the tip with a force in its axes, N, (3,)."""
        self._ask(force=_finite("force", force, 3))

    def hold(self, held: Held | None) -> None:  # type: ignore[override]
        """Put an object between the jaws, or take it away."""
        with self.loop.lock:
            self._operate()
            # Without a row it checks the object alone.
            self.loop.twin.run(np.zeros((0, len(self.inst.handle_joints))), held=held)
            self._ask(held=held)

    def request(self, what: ControllerRequest) -> None:
        """Request the controller to enable, disable, pause, resume or clear."""
        with self.loop.lock:
            self._ask()
            self.loop.request(what)

    def law(self, law: str, actuation: str) -> None:
        """Choose compensation law and actuation mode."""
        with self.loop.lock:
            self._ask()
            self.loop.choose(law, actuation)

    def reset(self) -> None:
        """Begin again with the twin at rest."""
        with self.loop.lock:
            self._operate()
            self.loop.begin()

    def restart(self) -> None:
        """Do nothing: the loop does not end before the page."""

    def load(self, instrument: str) -> None:
        """Refuse: the page shows one instrument."""
        raise LiveError(f"this page shows {self.inst.name} alone; start `tenodesis console` for another instrument.")

    def stop(self) -> None:
        """Pause the motors; anyone may."""
        with self.loop.lock:
            if self.loop.controller is not None or not self.inst.handle_joints:
                self.loop.request("pause")

    def stop_for(self, origin: str) -> None:
        """Pause the motors."""
        self.stop()

    def close(self) -> None:
        """Stop being the operator."""
        self.release()

    def _operate(self) -> None:
        if self.loop.operator != self.origin:
            raise LiveError(f"{self.origin} only watches; take control first.")

    def _ask(self, **changes: Any) -> None:
        """Ask for something in the operator's name, and let a twin that could not go on try again."""
        with self.loop.lock:
            self._operate()
            self.loop.asked = self.loop.asked._replace(**changes)
            self.loop.problem = None


def spool_radius(inst: FullForm) -> float:
    """Return the radius of the motors' spools, m."""
    return inst.drives.spool_radius if inst.spool_radius is None else inst.spool_radius


def _finite(key: str, values: ArrayLike, count: int) -> Array:
    given = np.asarray(values, float)
    if given.shape != (count,) or not np.isfinite(given).all():
        raise LiveError(key=key, value=given.tolist(), allowed=f"{count} finite numbers")
    return given
