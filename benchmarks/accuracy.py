"""How accurate the statics are, as the largest differences measured; the tests bound the same."""

import numpy as np
from peers import scipy_peer

import tenodesis as tn
from tenodesis.instrument import TendonGear

POINTS = 10_000
SHARE = 1e-3  # of a parameter, the step of the finite differences


def derivatives(inst: TendonGear) -> float:
    """Return the largest relative difference of derivatives of the output angle from fourth-order differences."""
    handle, force = 0.35, 0.9
    keys = ["distal_gear_radius", "proximal_gear_radius", "end_effector_length", "tendon_modulus", "tendon_diameter"]
    exact = tn.statics.gradient(tn.statics.output_angle, inst, handle, force, wrt=keys)
    worst = 0.0
    for key in keys:
        value = getattr(inst, key)
        at = [
            tn.statics.output_angle(inst.replace(**{key: value * (1 + n * SHARE)}), handle, force)
            for n in (-2, -1, 1, 2)
        ]
        numeric = (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * SHARE * value)
        worst = max(worst, abs(exact[key] / numeric - 1))
    return worst


def main() -> None:
    for name in ("real-size", "scaled-up"):
        inst = tn.load(name)
        assert isinstance(inst, TendonGear)
        random = np.random.default_rng(11)
        handle = random.uniform(-inst.handle_range, inst.handle_range, POINTS)
        force = random.uniform(-1.3, 1.3, POINTS) * tn.statics.slack_force(inst, 0.0)
        state = tn.statics.equilibrium(inst, handle, force)
        solved = np.isfinite(state.output_angle)
        slack = np.mean((state.agonist == 0) | (state.antagonist == 0))
        scipy = np.nanmax(np.abs(state.output_angle - scipy_peer.output_angle(inst, handle, force)))
        back = tn.statics.handle_angle(inst, state.output_angle[solved], force[solved])
        print(f"{name}: {POINTS} points, {100 * slack:.1f} % slack, {100 * (1 - solved.mean()):.1f} % past the fold")
        print(f"  output angle from SciPy's root finder {scipy:.1e} rad   target 1e-9")
        print(f"  inverse round trip                    {np.abs(back - handle[solved]).max():.1e} rad   target 1e-10")
        print(f"  derivatives from differences          {derivatives(inst):.1e} relative   target 1e-6")


if __name__ == "__main__":
    main()
