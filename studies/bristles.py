"""The law of all joints on a plant that shares nothing with its model: bristles along sheaths and pulleys.

    python studies/bristles.py

A needle driver of our own equations: each tendon a row of springs between points that bristles hold (Dahl's friction,
with more at rest than in motion), spread over the sheath and both pulleys; joints without inertia. Compliance is even
along the lengths that the file says, but for the anchor, or even from point to point, which puts half of it beyond the
stem. It homes, is commanded and loaded as in any_routing.py. Readings have noise and constant offsets, spool angles the
steps of their encoders, drives a lag.
"""

from concurrent.futures import ProcessPoolExecutor

import any_routing as cases
import law
import numpy as np
from numpy.typing import NDArray

from tenodesis.control import JointController, Request
from tenodesis.control.joints import JointLawName
from tenodesis.simulate import campaign

Array = NDArray[np.float64]

NAME = "needle-driver"
STEPS_A_TICK, TICK = 10, cases.STEP  # s
SHEATH, PITCH, JAW = 6, 3, 2
"""Points that bristles hold: in the sheath, on the pitch pulley, on the jaw's."""
POINTS = SHEATH + PITCH + JAW
ANCHOR = 0.05
"""Share of a tendon's compliance beyond the last point."""
BRISTLE, DRAG = 1e6, 10.0  # N/m, N s/m
AT_REST, SLOW = 1.15, 1e-4
"""Friction at rest over that in motion, and speed that tells them, m/s."""
CONSTANT = 0.02  # N a point
JOINT_DRAG = 0.01  # N m s/rad
STATES = [(state, direction) for state in range(len(cases.SHARES)) for direction in cases.DIRECTIONS]


class BristlePlant:
    """So many needle drivers at once, each with its friction, from rest.

    friction: coefficients, (n,); by_length: whether a tendon's compliance is that of one rope along the lengths of the
    file.
    """

    def __init__(self, friction: Array, seed: int, *, by_length: bool) -> None:
        inst = cases.tool(NAME)
        self.inst, self.count = inst, len(friction)
        self.arms, self.noise = inst.tendon_arms("tip"), np.random.default_rng(seed)
        joints, tendons = self.arms.shape[1], len(self.arms)
        self.draws = np.zeros((tendons, POINTS + 1, joints))
        # Tendons of the pitch end at its pulley, those of the jaws run over it.
        self.draws[:, SHEATH + PITCH, 0] = self.arms[:, 0]
        self.draws[:, -1, 1:] = self.arms[:, 1:]
        length = np.ones(POINTS)
        if by_length:
            length[:SHEATH] = inst.stem_length / SHEATH
            length[SHEATH:] = inst.tip_joints[1].offset / (PITCH + JAW)
        share = np.append((1 - ANCHOR) * length / length.sum(), ANCHOR)
        self.stiffness = inst.stiffnesses[:, np.newaxis] / share
        rates = np.zeros((tendons, POINTS, POINTS))
        for k in range(POINTS):
            rates[:, k, k] = self.stiffness[:, k] + self.stiffness[:, k + 1]
            if k:
                rates[:, k, k - 1] = rates[:, k - 1, k] = -self.stiffness[:, k]
        step = TICK / STEPS_A_TICK
        # Forward, points and joints between stiff springs would swing, and shake friction off.
        turning = np.einsum("mki,mk,mkj->ij", self.draws, self.stiffness, self.draws)
        self.turn_of_moment = np.linalg.inv(JOINT_DRAG * np.eye(joints) + step * turning)
        self.flow_of_pull = np.linalg.inv((DRAG + step * BRISTLE) * np.eye(POINTS) + step * rates)
        self.rest = inst.pretensions[:, np.newaxis]
        self.base = np.array([tendon.route[0].base_wrap or 0.0 for tendon in inst.tendons])
        self.friction = friction[:, np.newaxis, np.newaxis]
        self.spool, self.speed = np.zeros((2, self.count, tendons))
        self.place, self.bristle = np.zeros((2, self.count, tendons, POINTS))
        self.angle = np.zeros((self.count, joints))
        self.cells = self.noise.normal(0, inst.tension_sensors[0].offset, (self.count, tendons))
        self.tension = self._tensions()

    def _tensions(self) -> Array:
        ends = np.concatenate(
            [
                self.spool[..., np.newaxis] * self.inst.own_drives.spool_radius,
                self.place,
                np.zeros_like(self.place[..., :1]),
            ],
            axis=-1,
        )
        drawn = np.einsum("mkj,nj->nmk", self.draws, self.angle)
        return np.maximum(self.rest + self.stiffness * (ends[..., :-1] - ends[..., 1:] - drawn), 0.0)

    def _wraps(self) -> Array:
        """Return the bend at every point, rad."""
        turned = np.abs(self.angle)
        # A pulley that turns to a tendon's side unwinds it.
        on_pitch = np.abs(self.base - np.sign(self.arms[:, 0]) * self.angle[:, :1])
        wraps = np.empty((self.count, len(self.arms), POINTS))
        wraps[..., :SHEATH] = cases.BEND / SHEATH
        wraps[..., SHEATH : SHEATH + PITCH] = on_pitch[..., np.newaxis] / PITCH
        of_jaw = np.where(self.arms[:, 1:] != 0, turned[:, np.newaxis, 1:], 0.0).sum(-1)
        wraps[..., SHEATH + PITCH :] = of_jaw[..., np.newaxis] / JAW
        return wraps

    def step(self, velocity: Array, force: Array) -> None:
        """Go on by a tick with speeds of the spools (rad/s) and a force (N) at the first jaw, (n, 3)."""
        drives, dt = self.inst.own_drives, TICK / STEPS_A_TICK
        pitch, jaw = self.inst.tip_joints[0], self.inst.tip_joints[1]
        length, offset = jaw.end_effector_length or 0.0, jaw.offset
        coefficient = self.friction * self._wraps()
        for _ in range(STEPS_A_TICK):
            self.speed += dt / drives.time_constant * (velocity - self.speed)
            self.spool += dt * self.speed
            tension = self._tensions()
            pull = tension[..., :-1] - tension[..., 1:]
            flow = np.einsum("mkl,nml->nmk", self.flow_of_pull, pull - BRISTLE * self.bristle)
            most = coefficient * (tension[..., :-1] + tension[..., 1:]) / 2 + CONSTANT
            most *= 1 + (AT_REST - 1) * np.exp(-np.square(flow / SLOW))
            # Backward in what the bristle loses, which is stable however fast it slides.
            self.bristle = (self.bristle + dt * flow) / (1 + dt * BRISTLE * np.abs(flow) / most)
            self.place += dt * flow
            moment = np.einsum("mkj,nmk->nj", self.draws, tension)
            moment[:, 0] += (offset + pitch.chord + length * np.cos(self.angle[:, 1])) * force[:, 1]
            moment[:, 1] += length * force[:, 0]
            self.angle += dt * moment @ self.turn_of_moment
        self.tension = self._tensions()

    def read(self) -> tuple[Array, Array]:
        """Return tensions (N) and spool angles (rad) as sensors have them, (n, tendons)."""
        noise = self.noise.normal(0, self.inst.tension_sensors[0].noise, self.spool.shape)
        step = 2 * np.pi / self.inst.own_drives.encoder_counts / self.inst.own_drives.gear_ratio
        return self.tension[..., 0] + self.cells + noise, step * np.round(self.spool / step)


def trials(law_name: JointLawName, by_length: bool = True) -> dict[str, Array]:
    """Run all states and directions with all frictions at once; return by joint errors and more, deg, (n, joints)."""
    inst = cases.tool(NAME)
    given = STATES * len(law.ASSUMED)
    plant = BristlePlant(cases.COEFFICIENT * np.repeat(law.ASSUMED, len(STATES)), seed=1, by_length=by_length)
    aims = np.array([inst.bent(cases.bends_of(inst, state)) for state, _ in given])
    forces = cases.force_of(inst) * np.array([direction for _, direction in given])
    controllers = [JointController(inst, law_name) for _ in given]
    rising, loading = cases.eased(cases.HOMED, cases.ARRIVED)[:, 0], cases.eased(cases.LOADED, 0.1)[:, 0]
    requests = {0: Request.HOME, round(cases.RESUMED / TICK): Request.RESUME} if law_name == "joints" else {}
    kept: list[tuple[Array, ...]] = []
    for tick, (share, loaded) in enumerate(zip(rising, loading, strict=True)):
        tensions, spools = plant.read()
        asked = requests.get(tick, Request.NONE)
        said = [one.step(tensions[n], spools[n], (), share * aims[n], asked) for n, one in enumerate(controllers)]
        plant.step(np.array([one.spool_velocity for one in said]), loaded * forces)
        estimate = np.array([one.estimate.angle for one in said])
        std = np.array([one.estimate.angle_std for one in said])
        kept = [*kept[1 - round(cases.LAST / TICK) :], (plant.angle - aims, estimate - plant.angle, std)]
    error, off, std = (np.degrees(np.mean(one, axis=0)) for one in zip(*kept, strict=True))
    faults = np.array([", ".join(one.first_faults) for one in said])
    return {"error": error, "estimate": off, "normalised": off / std, "faults": faults}


def main() -> None:
    law.arguments(__doc__).parse_args()
    given: list[tuple[JointLawName, bool]] = [("off", True), ("joints", True), ("off", False), ("joints", False)]
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(trials, *zip(*given, strict=True)))
    for text, alone, own in zip(("by length", "even"), found[::2], found[1::2], strict=True):
        print(f"compliance {text}")
        show(alone, own)
    print("targets 0.3 RMS, 0.7 worst, farther by 0.3 at most, normalised 0.7 to 1.5, no fault")


def show(alone: dict[str, Array], own: dict[str, Array]) -> None:
    """Print what is left without and with the law, by friction."""
    print("friction  coupling RMS, worst  law RMS, worst  farther  estimate RMS  normalised  faults of either")
    for n, scale in enumerate([*law.ASSUMED, "all"]):
        rows = slice(None) if scale == "all" else slice(n * len(STATES), (n + 1) * len(STATES))
        farther = (np.abs(own["error"]) - np.abs(alone["error"]))[rows].max()
        print(
            f"{scale:>8}  {campaign.rms(alone['error'][rows]):.2f}, {campaign.farthest(alone['error'][rows]):.2f}"
            f"  {campaign.rms(own['error'][rows]):.2f}, {campaign.farthest(own['error'][rows]):.2f}  {farther:.2f}"
            f"  {campaign.rms(own['estimate'][rows]):.2f}  {campaign.rms(own['normalised'][rows]):.2f}"
            f"  {[str(one) for one in (*alone['faults'][rows], *own['faults'][rows]) if one]}"
        )


if __name__ == "__main__":
    main()
