"""The law on wrists: final errors of all axes at once, pushes on the neighbour, the grip while the wrist moves.

    python benchmarks/wrist.py

What runs is described in src/tenodesis/verification/wrist_law.py.
"""

import itertools
from typing import Annotated

import numpy as np
import typer

from tenodesis.verification.wrist_law import (
    DIRECTIONS,
    FORCES,
    FRICTION,
    STATES,
    Case,
    grip_kept,
    neighbour_push,
    run,
)


def errors(final: np.ndarray) -> tuple[float, float]:
    """Root of the mean square and largest size."""
    return float(np.sqrt(np.mean(final**2))), float(np.abs(final).max())


def main(name: Annotated[str, typer.Option(help="Instrument, or all.")] = "all") -> None:
    """Print final errors, off and robust, of every instrument."""
    for one in FORCES if name == "all" else (name,):
        print(f"{one}, {FORCES[one]:g} N in {len(DIRECTIONS)} directions, friction 0.7, 1, 1.3 of what is assumed")
        print(f"{'yaw, pitch':>12}  {'off RMS':>8} {'worst':>6}  {'robust RMS':>10} {'worst':>6}  {'push':>5}  faults")
        whole: dict[str, list[np.ndarray]] = {"off": [], "robust": []}
        pushes = []
        for state in STATES:
            rows: dict[str, list[Case]] = {"off": [], "robust": []}
            for law, (direction, friction) in itertools.product(rows, itertools.product(DIRECTIONS, FRICTION)):
                rows[law].append(run(one, state, direction, friction, law))
            finals = {law: np.concatenate([case.final for case in cases]) for law, cases in rows.items()}
            faults = {fault for case in rows["robust"] for fault in case.faults}
            pushes.append(max(neighbour_push(case) for case in rows["robust"]))
            figures = [
                value for law in rows for value in (np.sqrt(np.mean(finals[law] ** 2)), np.abs(finals[law]).max())
            ]
            print(
                f"{state[0]:>6}, {state[1]:>4}  {figures[0]:>8.2f} {figures[1]:>6.2f}  {figures[2]:>10.2f} "
                f"{figures[3]:>6.2f}  {pushes[-1]:>5.2f}  {', '.join(sorted(faults)) or 'none'}"
            )
            for law, final in finals.items():
                whole[law].append(final)
        figures = [figure for parts in whole.values() for figure in errors(np.concatenate(parts))]
        print(
            f"{'all':>12}  {figures[0]:>8.2f} {figures[1]:>6.2f}  {figures[2]:>10.2f} {figures[3]:>6.2f}  "
            f"{max(pushes):>5.2f}  (targets 0.3 RMS, 0.7 worst, 0.3 push)"
        )
        start, least, most = grip_kept(one)
        print(f"grip of {start:.2f} N while the wrist moves: {least:.3f} to {most:.3f} of it (target 0.95 to 1.05)\n")


if __name__ == "__main__":
    typer.run(main)
