"""Give the lost angle back: one protocol with and without the controller, recorded, compared, and run again.

    python examples/control.py

Recordings go to a folder that is deleted at the end; `tenodesis record` and `tenodesis info` do the same from a shell.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import tenodesis as tn
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record
from tenodesis.recording.summary import outcome, tip_error

# 1. The instrument on its bench, and what is done there: the tip bent by 60 deg, then 1 N pushes it back.
inst = tn.load("scaled-up")
step_load = tn.simulate.StepLoad(output_angle="60 deg", delay="0.5 s", force="1 N", duration="3 s")
protocol = tn.simulate.Protocol(name="push", phases=(step_load,))

# 2. Three ways to compensate: not at all, by eq. 22 as in the paper, and by the robust law with the friction observer.
controllers = {
    "none": None,
    "paper": tn.control.Controller(inst, observer="paper", law="paper", actuation="agonist"),
    "robust": tn.control.Controller(inst, observer="friction", law="robust", actuation="differential"),
}

with TemporaryDirectory() as folder:
    print("controller  lost at once  off at the end  faults  replay")
    for name, controller in controllers.items():
        # 3. Run and record. A recording contains the instrument, the protocol, and the controller's choices.
        path = Path(folder) / f"{name}.mcap"
        run = record(inst, protocol, path, controller=controller, seed=1)

        # 4. Distance of the tip from its target (eq. 18), just after the load is applied and at the end.
        off = np.degrees(tip_error(run, inst)[:, 0])
        pushed = np.argmax(run["force"] > 0)
        lost = off[pushed : pushed + 1000].min()

        # 5. Faults that the controller reports, and whether a replay of the recording repeats the run bit by bit.
        said = outcome(run, inst).get("faults", "-")
        same = "same bits" if replay(tn.Recording.open(path)).exact else "differs"
        print(f"{name:10}  {lost:8.2f} deg  {off[-1]:10.2f} deg  {said:6}  {same}")
