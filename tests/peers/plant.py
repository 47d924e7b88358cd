"""Plants that share no code with the twin: gears or pulleys, tendons with contacts, a tip, two spools, sensors.

They are NumPy over many lanes at once, written from the published equations: tendons that stretch between contacts
with capstan friction (Euler, Eytelwein), a tip with inertia, two spools on drives, sensors.
Each contact's slip is projected onto its friction law from where the step began, in red-black Gauss-Seidel sweeps,
until no slip changes by more than :data:`SETTLED`; the tip is integrated by velocity Verlet. The twin eliminates its
contacts directly and integrates by the trapezoidal rule.

``Plants(lanes)`` makes plants, ``plants.step(handle_angle, force, spool_velocity)`` advances them by a tick and
``plants.read()`` reads their sensors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.instrument import Instrument

Array = NDArray[np.float64]

PERIOD = 5e-4  # s, of ticks
SETTLED = 1e-10  # m
MOST_SWEEPS = 200
SWEEPS_BETWEEN_CHECKS = 3
# Of a sub-step, in radians of the tip's fastest oscillation, on its last segments alone; Verlet is unstable from 2 on.
PHASE_STEP = 0.4
LEAST_SUBSTEPS = 2


@dataclass(frozen=True)
class Plant:
    """One lane of the family, in SI units; :func:`plant_of` makes it of an instrument's numbers."""

    gears: bool
    """Whether joints are rolling gears, else pulleys"""
    proximal_radius: float
    distal_radius: float
    tip_length: float
    """From the distal joint's moving centre to where the force acts"""
    stiffness: float
    """Of a whole tendon, N/m"""
    pretension: float
    shares: tuple[float, ...]
    """Compliance of each segment over the tendon's, from the spool: sheath, handle, stem, tip; with two vertices a
    joint sheath, handle, span over the handle's joint, stem, span over the tip's joint, end"""
    vertex: float
    """Friction coefficient at the vertices"""
    sheath: float
    """Friction exponent of the sheath"""
    inertia: float
    damping: float
    stop: float
    stop_stiffness: float
    base: float = 0.0
    """Friction exponent that remains at each joint when it is straight"""
    sheath_rate: float = 0.0
    """Growth of the sheath's exponent by the size of the handle's angle"""
    spool_radius: float = 5e-3
    speed_limit: float = 20.0
    acceleration_limit: float = 400.0
    time_constant: float = 0.01
    spool_step: float = 2 * np.pi / 4096
    angle_step: float = 2 * np.pi / 4096
    angle_noise: float = 0.0
    tension_step: float = 400 / 65536
    tension_noise: float = 0.0
    tension_range: float = 200.0
    cell_gain: tuple[float, float] = (1.0, 1.0)
    cell_offset: tuple[float, float] = (0.0, 0.0)
    handle_offset: float = 0.0
    """Of the handle's encoder"""
    hand_stiffness: float = np.inf
    """Of the hand on the handle, N m/rad; infinite: the handle is where it is commanded"""
    hand_damping: float = 0.05
    hand_inertia: float = 2e-3
    tissue_angle: float = np.inf
    """Output angle at which the tip touches tissue"""
    tissue_stiffness: float = 0.0
    """N/m, at the tip"""
    tissue_damping: float = 0.0
    """N s/m"""

    @property
    def contacts(self) -> int:
        return len(self.shares) - 1

    @property
    def substeps(self) -> int:
        """Sub-steps of a tick, such that the tip on its last segments alone is well resolved."""
        own = sum(self.shares[-1:] if self.contacts == 3 else self.shares[-2:-1])
        stiffest = 2 * self.stiffness / own * self.distal_radius**2 + self.stop_stiffness
        stiffest += self.tissue_stiffness * (self.tip_length + self.distal_radius) ** 2
        return max(LEAST_SUBSTEPS, int(np.ceil(PERIOD * np.sqrt(stiffest / self.inertia) / PHASE_STEP)))

    def handle_angle(self, output: float) -> float:
        """Return the handle's angle that gives an output angle without load and friction."""
        ratio = self.distal_radius / self.proximal_radius
        return float(2 * np.arcsin(ratio * np.sin(output / 2)) if self.gears else ratio * output)


def shares_of(inst: Instrument, vertices: int = 1, before_handle: float | None = None) -> tuple[float, ...]:
    """Return the segments' shares of compliance, by length; before_handle: share between spool and handle joint."""
    numbers: Any = inst
    gears = inst.joint_type == "tendon-gear"
    length = inst.tendon_length or inst.overall_length
    at_handle, at_tip = (
        2 * getattr(numbers, f"{end}_{'gear' if gears else 'pulley'}_radius") / length for end in ("proximal", "distal")
    )
    before = inst.handle_length / length if before_handle is None else before_handle
    stem = 1 - before - at_handle - at_tip
    if vertices == 1:
        return before / 2, before / 2 + at_handle, stem, at_tip
    end = at_tip / 2
    return before / 2, before / 2, at_handle, stem - end, at_tip, end


def plant_of(
    inst: Instrument, *, vertices: int = 1, before_handle: float | None = None, softer: float = 1.0, **changes: Any
) -> Plant:
    """Return a plant with the numbers of an instrument of one axis, and changes of :class:`Plant`'s fields.

    vertices: per joint, 1 with its whole wrap or 2 with the span that the joint draws between them, half the wrap each;
    softer: true over assumed stiffness of the tendons.
    """
    numbers: Any = inst
    gears = inst.joint_type == "tendon-gear"
    kind = "gear" if gears else "pulley"
    drives, sensors, friction, dynamics = inst.drives, inst.sensors, inst.friction, inst.dynamics
    radius = getattr(numbers, f"distal_{kind}_radius")
    rotational = 2 * inst.tendon_stiffness * radius**2
    inertia = dynamics.tip_inertia or rotational / (2 * np.pi * 20) ** 2
    damping = 0.4 * np.sqrt(rotational * inertia) if dynamics.tip_damping is None else dynamics.tip_damping
    plant = Plant(
        gears=gears,
        proximal_radius=getattr(numbers, f"proximal_{kind}_radius"),
        distal_radius=radius,
        tip_length=inst.end_effector_length,
        stiffness=inst.tendon_stiffness * softer,
        pretension=inst.pretension,
        shares=shares_of(inst, vertices, before_handle),
        vertex=friction.vertex_coefficient,
        sheath=friction.sheath_coefficient * friction.sheath_bend,
        sheath_rate=friction.sheath_coefficient * friction.sheath_bend_per_handle_angle,
        inertia=inertia,
        damping=damping,
        stop=inst.output_stop,
        stop_stiffness=20 * rotational,
        spool_radius=drives.spool_radius,
        speed_limit=drives.motor_speed / drives.gear_ratio,
        acceleration_limit=drives.motor_acceleration / drives.gear_ratio,
        time_constant=drives.time_constant,
        spool_step=2 * np.pi / drives.encoder_counts / drives.gear_ratio,
        angle_step=sensors.encoder_range / 2**sensors.encoder_bits,
        angle_noise=sensors.encoder_noise,
        tension_step=2 * sensors.load_cell_range / 2**sensors.load_cell_bits,
        tension_noise=sensors.load_cell_noise,
        tension_range=sensors.load_cell_range,
    )
    return replace(plant, **changes)


class Plants:
    """Plants of the same joints and number of contacts, advanced together by ticks; arrays end with the lane.

    A tension is ``pretension + k (drawn + slip before - slip beyond)``, where a slip is the length that has passed a
    contact toward the spool. Contacts stick while the tension on neither side exceeds that on the other by more than
    the factor exp(exponent). Spools start where the tendons have their pretension.

    Parameters
    ----------
    lanes
        The plants.
    seeds
        Of each lane's sensor noise.
    substeps
        Of a tick; by default what the fastest lane needs.
    """

    def __init__(self, lanes: Sequence[Plant], seeds: Sequence[int] | None = None, substeps: int | None = None) -> None:
        kinds = {(lane.gears, lane.contacts) for lane in lanes}
        if len(kinds) != 1:
            raise ValueError("lanes differ in their joints or contacts; they must be run apart.")
        (self.gears, self.contacts), count = kinds.pop(), len(lanes)
        self.lanes = tuple(lanes)
        self.substeps = substeps or max(lane.substeps for lane in lanes)
        self.dt = PERIOD / self.substeps
        # Fields of a plant with two or more values are of shape (value, lane).
        values = {field.name: np.array([getattr(lane, field.name) for lane in lanes], float) for field in fields(Plant)}
        self._of = SimpleNamespace(**{name: value.T for name, value in values.items()})
        n = self.contacts
        p = self._of
        self._k = (p.stiffness / p.shares)[:, None]  # (segment, 1, lane)
        self._drawn_at = (1, 3) if n == 3 else (2, 4)  # by handle and tip
        self._growth = self._k[1:] / self._k[:-1]
        self._soft = 1 / self._k[:-1]
        self._half = 1.0 if n == 3 else 0.5
        self._signs = np.array([[1.0], [-1.0]])

        self.tip, self.tip_velocity, self._acceleration = np.zeros((3, count))
        self.handle, self.handle_velocity, self._handle_acceleration = np.zeros((3, count))
        self._wanted = np.zeros(count)
        self.spool, self.spool_velocity = np.zeros((2, 2, count))
        self._slip = np.zeros((n + 2, 2, count))  # with both ends, which never slip
        self._rate = np.zeros((n, 2, count))
        self._held, self._kept = np.zeros((2, n, 2, count))
        self.tension = np.broadcast_to(p.pretension, (n + 1, 2, count)).copy()
        self._relaxed = np.zeros((n + 1, 2, count))
        self._edges, self._weight = np.zeros((2, n, 2, 2, count))  # (contact, edge, tendon, lane)
        self._ratio = np.ones((n, 2, 1, count))
        # Each phase of a sweep takes every other contact.
        self._phases = [self._phase(start) for start in range(2)]
        self.dissipated = np.zeros(count)
        self.least_dissipated = 0.0
        self.touch = np.zeros(count)
        self.sweeps = self.most_sweeps = 0
        self._any_tissue = bool(np.any(np.isfinite(p.tissue_angle)))
        self._soft_hand = np.isfinite(p.hand_stiffness)
        self._random = [np.random.default_rng(seed) for seed in seeds or range(count)]
        self._noise, self._noise_row = np.zeros((0, count, 3)), 0

    def _phase(self, start: int) -> tuple[Array, ...]:
        n, slip = self.contacts, self._slip
        own = slip[1 + start : n + 1 : 2]
        edges = self._edges[start::2]
        return (
            slip[start:n:2],
            slip[2 + start : n + 2 : 2],
            own,
            self._held[start::2],
            self._weight[start::2],
            edges,
            np.empty_like(own),
            np.empty_like(edges),
        )

    @property
    def drawn(self) -> Array:
        """Shape (2, lane): length that the handle and that the tip takes of the agonist, m."""
        p = self._of
        return np.array([self._excursion(p.proximal_radius, self.handle), self._excursion(p.distal_radius, self.tip)])

    def _excursion(self, radius: Array, angle: Array) -> Array:
        return 2 * radius * np.sin(angle / 2) if self.gears else radius * angle

    def _arm(self, radius: Array, angle: Array) -> Array:
        return radius * np.cos(angle / 2) if self.gears else radius

    @property
    def target(self) -> Array:
        """Output angle without load and friction at the present angle of the handle (eq. 18)."""
        p = self._of
        ratio = p.proximal_radius / p.distal_radius
        output = 2 * np.arcsin(ratio * np.sin(self.handle / 2)) if self.gears else ratio * self.handle
        return np.clip(output, -p.stop, p.stop)

    def step(self, handle_angle: ArrayLike, force: ArrayLike = 0.0, spool_velocity: ArrayLike = 0.0) -> None:
        """Advance by a tick.

        Parameters
        ----------
        handle_angle
            At the tick's end, rad, shape (lane,) or scalar; moved to linearly. With a hand, what the hand wants.
        force
            At the tip and square to it, against positive flexion, N.
        spool_velocity
            Commanded, rad/s, positive winds, shape (2, lane) or scalar.
        """
        wanted, velocity = np.asarray(handle_angle, float), np.asarray(spool_velocity, float)
        begin = self._wanted
        for part in range(1, self.substeps + 1):
            self._substep(begin + (wanted - begin) * (part / self.substeps), np.asarray(force, float), velocity)
        self._wanted = wanted

    def _substep(self, wanted: Array, force: Array, command: Array) -> None:
        p = self._of
        dt = self.dt
        # First-order loop, by its exact solution for a constant command.
        follow = -np.expm1(-dt / p.time_constant)
        goal = np.clip(command, -p.speed_limit, p.speed_limit)
        most = p.acceleration_limit * dt
        change = np.clip((goal - self.spool_velocity) * follow, -most, most)
        self.spool = self.spool + (self.spool_velocity + change / 2) * dt
        self.spool_velocity = self.spool_velocity + change

        if self._soft_hand.any():
            moved = self.handle + dt * self.handle_velocity + dt * dt / 2 * self._handle_acceleration
            self.handle = np.where(self._soft_hand, moved, wanted)
        else:
            self.handle = wanted + np.zeros_like(self.tip)
        self.tip = self.tip + dt * self.tip_velocity + dt * dt / 2 * self._acceleration
        self._settle()

        at_handle, at_tip = self._drawn_at
        arm = self._arm(p.distal_radius, self.tip)
        lever = p.tip_length + arm if self.gears else p.tip_length
        moment = (self.tension[at_tip, 0] - self.tension[at_tip, 1]) * arm
        moment -= force * lever
        beyond = self.tip - np.clip(self.tip, -p.stop, p.stop)
        moment -= p.stop_stiffness * beyond
        damping = p.damping
        if self._any_tissue:
            self.touch = self._tissue(lever)
            moment -= self.touch * lever
        before = self.tip_velocity + dt / 2 * self._acceleration
        self.tip_velocity = (before + dt / 2 * moment / p.inertia) / (1 + dt / 2 * damping / p.inertia)
        self._acceleration = (moment - damping * self.tip_velocity) / p.inertia
        if self._soft_hand.any():
            self._move_hand(wanted, (self.tension[at_handle, 0] - self.tension[at_handle, 1]))

    def _tissue(self, lever: Array) -> Array:
        p = self._of
        deep = self.tip - p.tissue_angle
        pushed = lever * (p.tissue_stiffness * np.maximum(deep, 0) + p.tissue_damping * self.tip_velocity)
        return np.where(deep > 0, np.maximum(pushed, 0), 0.0)

    def _move_hand(self, wanted: Array, difference: Array) -> None:
        p = self._of
        dt, inertia = self.dt, p.hand_inertia
        stiffness = np.where(self._soft_hand, p.hand_stiffness, 0)
        torque = stiffness * (wanted - self.handle) - difference * self._arm(p.proximal_radius, self.handle)
        before = self.handle_velocity + dt / 2 * self._handle_acceleration
        self.handle_velocity = (before + dt / 2 * torque / inertia) / (1 + dt / 2 * p.hand_damping / inertia)
        self._handle_acceleration = (torque - p.hand_damping * self.handle_velocity) / inertia

    def _settle(self) -> None:
        """Solve the contacts for the present spools, handle and tip."""
        p = self._of
        n, slip, relaxed = self.contacts, self._slip, self._relaxed
        by_handle, by_tip = self.drawn
        at_handle, at_tip = self._drawn_at
        relaxed[:] = p.pretension
        relaxed[0] += self._k[0] * (p.spool_radius * self.spool)
        relaxed[at_handle] += self._k[at_handle] * self._signs * by_handle
        relaxed[at_tip] -= self._k[at_tip] * self._signs * by_tip

        bent = np.abs(self.handle), np.abs(self.tip)
        joints = [np.exp(self._half * (p.vertex * angle + p.base)) for angle in bent]
        up = self._ratio[:, 0, 0]
        up[0] = np.exp(p.sheath + p.sheath_rate * bent[0])
        up[1 : (n + 1) // 2] = joints[0]
        up[(n + 1) // 2 :] = joints[1]
        np.divide(1, self._ratio[:, 0], out=self._ratio[:, 1])

        # Slip at which a contact is on the edge, to the spool or to the tip, as a line of its neighbours' slips.
        np.divide(1, 1 + self._ratio * self._growth[:, None], out=self._weight[:])
        np.multiply(self._ratio, relaxed[1:, None], out=self._edges)
        np.subtract(relaxed[:-1, None], self._edges, out=self._edges)
        self._edges *= self._weight
        self._edges *= self._soft[:, None]

        own = slip[1:-1]
        self._held[:] = own
        own += self._rate
        self._sweep(own)
        np.subtract(own, self._held, out=self._rate)
        np.subtract(slip[:-1], slip[1:], out=self.tension)
        self.tension *= self._k
        self.tension += relaxed
        np.maximum(self.tension, 0, out=self.tension)
        lost = ((self.tension[:-1] - self.tension[1:]) * self._rate).sum((0, 1))
        self.least_dissipated = min(self.least_dissipated, float(lost.min()))
        self.dissipated += lost

    def _sweep(self, own: Array) -> None:
        """Project slips (contact, tendon, lane) onto the friction law until each lane has settled."""
        kept, done = self._kept, np.zeros(own.shape[-1], bool)
        for sweep in range(1, MOST_SWEEPS + 1):
            check = sweep % SWEEPS_BETWEEN_CHECKS == 0
            before = own.copy() if check else own
            for near, far, mine, start, weight, edges, gap, edge in self._phases:
                np.subtract(near, far, out=gap)
                np.multiply(weight, gap[:, None], out=edge)
                np.add(edge, far[:, None], out=edge)
                np.add(edge, edges, out=edge)
                np.maximum(start, edge[:, 0], out=mine)
                np.minimum(mine, edge[:, 1], out=mine)
            if not check:
                continue
            # A lane ends where it has settled itself, so that it does not depend on those beside it.
            fresh = (np.abs(own - before).max((0, 1)) < SETTLED) & ~done
            if fresh.all():
                break
            kept[..., fresh] = own[..., fresh]
            done |= fresh
            if done.all():
                own[:] = kept
                break
        self.sweeps, self.most_sweeps = sweep, max(sweep, self.most_sweeps)

    def residual(self) -> Array:
        """Return by how much (N) the last sub-step's tensions violate the friction law: (contact, tendon, lane)."""
        spool, tip, ratio = self.tension[:-1], self.tension[1:], self._ratio[:, 0]
        beyond_spool, beyond_tip = spool - ratio * tip, tip - ratio * spool
        least = SETTLED
        return np.where(
            self._rate > least,
            np.abs(beyond_spool),
            np.where(self._rate < -least, np.abs(beyond_tip), np.maximum(np.maximum(beyond_spool, beyond_tip), 0)),
        )

    def read(self) -> Array:
        """Return the sensors' readings: handle angle, tensions, spool angles, shape (lane, 5)."""
        p = self._of
        if self._noise_row == len(self._noise):
            self._noise = np.stack([own.standard_normal((1000, 3)) for own in self._random], 1)
            self._noise_row = 0
        noise = self._noise[self._noise_row].T
        self._noise_row += 1
        angle = self.handle + p.handle_offset + p.angle_noise * noise[0]
        tension = p.cell_gain * self.tension[0] + p.cell_offset + p.tension_noise * noise[1:]
        found = np.empty((len(self.lanes), 5))
        found[:, 0] = np.round(angle / p.angle_step) * p.angle_step
        found[:, 1:3] = np.clip(
            np.round(tension / p.tension_step) * p.tension_step, -p.tension_range, p.tension_range
        ).T
        found[:, 3:] = (np.round(self.spool / p.spool_step) * p.spool_step).T
        return found
