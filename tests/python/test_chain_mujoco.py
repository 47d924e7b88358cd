"""The statics of joints and tendons against the same mechanism settled in MuJoCo."""

from collections.abc import Callable

import numpy as np
import pytest
from peers.chain_peer import ChainPeer

from tenodesis import instrument
from tenodesis.instrument import FullForm
from tenodesis.statics import Axes, Status, chain

from .chain_samples import LISTED, Point, backbone, drawn, holds, jaws

ALLOWED = 0.05  # deg
OFF_PULLEY = np.radians(88)  # where the peer's tendons leave a pulley

SHIPPED = [pytest.param(lambda name=name: instrument.expanded(name), id=name) for name in LISTED]
SHIPPED += [pytest.param(lambda: instrument.in_arcs("two-segment-continuum", 4), id="in arcs")]
SAMPLES = [pytest.param(jaws, id="jaws"), pytest.param(backbone, id="backbone")]


def compare(inst: FullForm, cases: int, loss: float) -> tuple[float, int, int, int]:
    """Settle random cases whose loads turn a joint by about `loss` (rad) each.

    Returns the largest difference, deg, and how many cases were compared, were slack, and are disputed.
    """
    random = np.random.default_rng(5)
    peer = ChainPeer(inst)
    handles = len(inst.handle_joints)
    straight = chain.rates(inst, 0.0)
    by_wrench = np.abs(straight.by_wrench)
    heaviest = np.repeat([loss / by_wrench[:, :3].max(), loss / by_wrench[:, 3:].max()], 3)
    # A trigger whose tendon is slack at rest moves nothing there.
    ranges = np.array([joint.range for joint in inst.handle_joints])
    widest = np.minimum(0.7 / np.abs(straight.by_handle).max(axis=0).clip(min=0.1), ranges)
    grip = loss / np.abs(straight.by_grip).max() if inst.grip else 0.0
    longest = np.minimum(2e-4, inst.pretensions.max() / inst.stiffnesses / 2)
    worst, compared, slack, disputed = 0.0, 0, 0, 0
    for case in range(cases):
        axes: Axes = "tip" if case % 2 else "stem"
        handle = random.uniform(-widest, widest, handles)
        wrench = random.uniform(-heaviest, heaviest)
        force = random.uniform(-grip, grip) if grip else 0.0
        strokes = random.uniform(-1, 1, len(inst.tendons)) * longest
        loads = {"grip_force": [force], "strokes": strokes, "axes": axes}
        ours = chain.equilibrium(inst, handle, wrench, **loads)  # type: ignore[arg-type]
        if np.abs(ours.angles).max() > OFF_PULLEY:
            continue
        theirs = peer.settle(handle, wrench, grip_force=force, strokes=strokes, axes=axes)
        disputed += np.isnan(ours.angles).any() != np.isnan(theirs.angles).any()
        off = ours.angles[0] - theirs.angles
        difference = np.degrees(max(abs(off[arcs].sum()) for arcs in inst.bends.values()))
        if np.isfinite(difference):
            compared += 1
            slack += ours.tensions.min() == 0
            worst = max(worst, float(difference))
            assert ours.tensions[0] == pytest.approx(theirs.tensions, rel=1e-2, abs=1e-2)
    return worst, compared, slack, disputed


@pytest.mark.parametrize("make", [*SHIPPED, *SAMPLES])
def test_angles_and_tensions_agree_with_the_mechanism_settled_in_mujoco(make: Callable[[], FullForm]) -> None:
    worst, compared, _, disputed = compare(make(), 8, 0.1)
    assert worst <= ALLOWED
    assert compared == 8
    assert not disputed


@pytest.mark.slow
@pytest.mark.parametrize("make", SHIPPED)
def test_they_agree_over_three_hundred_loads_with_slack_tendons(make: Callable[[], FullForm]) -> None:
    worst, compared, slack, disputed = compare(make(), 300, 0.3)
    assert worst <= ALLOWED
    assert compared >= 270
    assert slack >= 20
    assert disputed <= 3


@pytest.mark.slow
def test_random_wrists_settle_where_the_statics_have_them() -> None:
    compared = slack = 0
    for seed in range(30):
        inst = drawn(seed)
        if not holds(inst):
            continue
        peer = ChainPeer(inst)
        for axes in ("tip", "stem"):
            point = Point(inst, seed, 0.1)
            ours = chain.equilibrium(inst, [point.handle], **point.load(axes=axes))
            if np.abs(ours.angles).max() > OFF_PULLEY:
                continue
            theirs = peer.settle(point.handle, point.wrench, grip_force=point.grip, strokes=point.strokes, axes=axes)
            assert theirs.angles == pytest.approx(ours.angles[0], abs=np.radians(ALLOWED), nan_ok=True)
            compared += ours.status[0] == Status.OK
            slack += ours.tensions.min() == 0
    assert compared >= 50
    assert slack >= 20
