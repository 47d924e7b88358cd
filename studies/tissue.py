"""How hard the tip presses on tissue that is in its way, with the motors off and with the controller.

Peer: the same instrument with its motors standing at home, with the same hand, load and tissue, which is a spring and a
damper at the tip (:class:`tenodesis.twin.Contact`).
"""

from typing import Any

import law
import numpy as np

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column
from tenodesis.twin import Contact, Twin

STIFFNESSES = (0.1, 0.3, 1.0, 3.0, 10.0)  # N/mm
RELAXATION = 5e-3  # s, damping over stiffness
EASED, LOADED, SECONDS = 1.2, 1.5, 6.0  # s
END = 1.0  # s, in which the tip is judged at rest or not
SWINGING, NO_FORCE = 0.2, 0.01  # deg peak to peak, N
STATES = ((33, 28, 0), (33, 20, 0), (67, 60, 0), (67, 40, 0), (0, -5, 1))
"""Where the hand wants the tip, and where tissue is in its way, deg; the share of the rated force, which pushes the tip
into tissue in extension."""


def press(instrument: str, state: tuple[float, float, float], stiffness: float) -> dict[str, Any]:
    """Run into tissue of some stiffness, N/mm: contact force, N, and how the tip swings at the end, deg."""
    inst, (hand, place, load) = law.instrument(instrument), state
    time = law.clock(SECONDS)
    handle = float(tn.statics.handle_angle(inst, np.radians(hand))) * law.eased(time, EASED)
    force = law.RATED[instrument] * load * law.eased(time - EASED, LOADED - EASED)
    side: Any = "extension" if place < 0 else "flexion"
    contact = Contact(np.radians(place), 1e3 * stiffness, 1e3 * stiffness * RELAXATION, side)
    found: dict[str, Any] = {}
    for name, controller in (("off", None), ("on", Controller(inst))):
        run = Twin(inst).run(handle, force, contact=contact, controller=controller)
        pressed, end = np.abs(run["contact_force"]), run.time > SECONDS - END
        found[f"peak_{name}"], found[f"final_{name}"] = pressed.max(), pressed[end].mean()
        found[f"swing_{name}"] = np.degrees(np.ptp(run["output_angle"][end]))
        found["faults"] = law.faults(run)
    for what in ("peak", "final"):
        on, off = found[f"{what}_on"], found[f"{what}_off"]
        # NaN where neither presses.
        found[f"{what}_ratio"] = on / off if off > NO_FORCE else np.inf if on > NO_FORCE else np.nan
    return found


PRESSED = [
    Column(f"{what} {which}", f"{what}_{which}")
    for what in ("peak", "final", "swing")
    for which in ("off", "on", "ratio")
    if (what, which) != ("swing", "ratio")
]
RATIOS = [
    Column(f"{words} {what} over off, ", f"{what}_ratio", over)
    for what in ("peak", "final")
    for words, over in (("mean", np.nanmean), ("worst", np.nanmax))
]
TARGETS = (
    (f"tips that swing by more than {SWINGING:g}°", "swing_on", SWINGING),
    ("and with motors off", "swing_off", SWINGING),
    ("faults", lambda row: len(row["faults"]), 0),
)


def main() -> None:
    options = law.arguments(__doc__, law.RATED).parse_args()
    cases = campaign.cases(instrument=options.instrument or law.RATED, state=STATES, stiffness=STIFFNESSES)
    rows = campaign.run(press, cases, "tissue", results=options.results)
    print(f"contact force, N; the tip in the last {END:g} s, deg peak to peak; a hand at and tissue from, deg, load")
    columns = [*PRESSED, Column("faults", "faults", campaign.names, "")]
    print(campaign.table(rows.by("instrument", "state", "stiffness"), columns, ("instrument", "state", "N/mm")))
    law.show(
        options,
        "tissue",
        rows.by("instrument"),
        [*RATIOS, Column("largest force, N", "peak_on", np.max)],
        "instrument",
        unit="",
    )
    for target in TARGETS:
        print(campaign.verdict(target[0], rows, *target[1:]))


if __name__ == "__main__":
    main()
