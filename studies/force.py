"""How well the observer knows the force at the tip, resting and moving, and whether its interval covers the truth.

On the plants of :mod:`plants`, which share no code with the twin: 1.5 N on the scaled-up instrument in the four states
of Fig. 15, friction assumed as 0.7, 1 and 1.3 times what it is.

Peer: eq. 1 with the tensions that the load cells read, at the true output angle.
"""

from pathlib import Path
from typing import Any

import law
import numpy as np
from plants import LAST, LOADED, ROWS, Case, CaseResponse, cases_of, run

from tenodesis.paper.tip_force import by_tensions, drawing, judge
from tenodesis.report import style
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column

ROWS_OF_FORCE = ("nothing", "two", "front", "rough", "four", "gains", "soft", "base", "two-front", "real", "real-two")
SECONDS = 8.0
SWAY, RATE = np.radians(3), 0.5  # of the handle, Hz
SETTLED = 0.3  # s after the load


def plain(case: Case, response: CaseResponse) -> law.Array:
    """Tip force by eq. 1 from the tensions as read, N."""
    return by_tensions(case.known, response.tip, response.read.T)


WORKS: dict[str, dict[str, Any]] = {
    "rest, before a stroke": {"law": "off"},
    "rest, after strokes": {},
    "moving": {"tremor": float(SWAY), "rate": RATE},
}


def trial(row: str, work: str) -> dict[str, float]:
    """Judge the estimates of a row of plants at work, N; covered is the share of time within its interval of 95 %."""
    cases = [case._replace(**WORKS[work]) for case in cases_of(ROWS[row]) if case.known is not None]
    responses = run(cases, SECONDS)
    begin = LOADED + SETTLED if work != "rest, after strokes" else SECONDS - LAST
    within = (responses[0].time > begin) & (responses[0].time <= SECONDS)
    off = [response.force[within] - case.force for case, response in zip(cases, responses, strict=True)]
    missed = [plain(case, one)[within] - case.force for case, one in zip(cases, responses, strict=True)]
    return judge(off, [response.force_std[within] for response in responses], missed)._asdict()


def draw(path: Path, case: Case) -> None:
    """Draw the force of a case over time: load, estimate with its interval, eq. 1."""
    (response,) = run([case], SECONDS)
    every = slice(2000, None, 20)
    load = np.where(response.time > LOADED, case.force, 0.0)
    with style.applied():
        chart = drawing(
            *(one[every] for one in (response.time, load, response.force, response.force_std, plain(case, response)))
        )
        chart.figure.savefig(path, metadata={"Date": None})


JUDGED = [
    Column("error", "error", form=".3f"),
    Column("worst", "worst", form=".3f"),
    Column("stated", "deviation", form=".3f"),
    Column("covered, ", "covered", form=".1%"),
    Column("eq. 1", "plain", form=".3f"),
]


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], default=ROWS_OF_FORCE, metavar="ROW")
    parser.add_argument("--figure", type=Path, help="draw one case of two vertices a joint into this SVG file")
    options = parser.parse_args()
    rows = campaign.run(trial, campaign.cases(row=options.rows, work=WORKS), "force", results=options.results)
    groups = {(ROWS[row].words, work): own for (row, work), own in rows.by("row", "work").items()}
    law.show(options, "force", groups, JUDGED, ("what differs", ""), unit="N")
    if options.figure:
        case = next(case for case in cases_of(ROWS["two"]) if np.isclose(case.output, np.radians(67)))
        draw(options.figure, case)


if __name__ == "__main__":
    main()
