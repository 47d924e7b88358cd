"""An experiment of ten repetitions on the instrument of a running console: bend, load, switch the law, read, record.

    tenodesis console scaled-up        # in one terminal; release the operation of its page
    python examples/ten_repetitions.py # in another, by the same user

The folder of the runtime, which only its owner can enter, is the key. Whoever looks at the page sees what the script
does, and can stop it; if the script ends or fails, the controller pauses.
"""

import sys
import time

import numpy as np

import tenodesis as tn


def main(folder: str | None = None, repetitions: int = 10, settle: float = 1.0) -> list[dict[str, float]]:
    """Return the loss of angle under 1 N at a bend of the handle of 20 deg by law, deg, for each repetition."""
    found = []
    with tn.live.connect(folder, origin="ten repetitions") as bench:
        bench.request("enable")
        path = bench.record(True, called="repetitions")
        for _ in range(repetitions):
            lost = {}
            for law in ("off", "robust"):
                bench.law(law, "differential")
                bench.hand(np.full(len(bench.names.handle_joints), np.radians(20)))
                time.sleep(settle)
                before = bench.latest()
                bench.force(np.ones(len(bench.names.joints)))
                time.sleep(settle)
                after = bench.latest()
                change = np.subtract(before["measured_output_angle"], after["measured_output_angle"])
                lost[law] = float(np.degrees(np.abs(change).max()))
                bench.force(np.zeros(len(bench.names.joints)))
            found.append(lost)
            print(", ".join(f"{law}: {angle:.2f} deg" for law, angle in lost.items()))
        bench.hand(np.zeros(len(bench.names.handle_joints)))
        bench.record(False)
        print(f"Recorded to {path}.")
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
