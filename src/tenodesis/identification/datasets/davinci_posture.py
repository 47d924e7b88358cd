"""The da Vinci tool on the same bench with its wrist held at several pitch angles: one model of the whole wrist.

O'Neill, Stephens and Kowalewski, IEEE RA-L 3(4):3027-3034, 2018. Files as `davinci_tool` reads them, whose names have
the pitch in degrees: pitch+60_000.TXT.

The jaw's tendons run over pulleys at the wrist, and pitch draws them, so that the jaw's zero moves by the wrist's
coupling. The shaft is straight: the loaded tendon rubs where it leaves the spindle, by the friction exponent, and at
the wrist, in proportion to the angle by which it is wrapped there. That is a right angle at zero pitch, and less by as
much as the pitch draws the tendon, as on every pulley (joint.hpp). With u the torque at the spindle, u[1] and u[2] past
either contact (as the tool's):

    wrap = |pi/2 -+ pitch|                                       - where pitch draws the loaded tendon
    u[1] = u behind friction_exponent,  u[2] = u[1] behind wrist_friction wrap
    jaw  = offset + coupling pitch + own offset +- (ratio spindle + compliance (u[1] + u[2]) / 2)

Where less is held back at the wrist, the stretch beyond it follows more of the load: at small loads the jaw lags more.
The right angle and the sign are what recordings at three pitches show when both are free (1.57 +- 0.06 rad), as is the
half of the compliance beyond the wrist; the way of the tendons in this tool is not published. Its tool file gives the
arm of the jaw's tendons about pitch, and so the coupling, but no wrap; lengths put 3 % of the compliance there.

A recording starts at a stop of the jaw, which leaves it an offset of its own. That is taken out of its errors; a small
share of it counts in the fit, by which offset and coupling are known.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tenodesis import _core
from tenodesis.errors import IdentificationError
from tenodesis.identification.datasets import davinci_tool
from tenodesis.identification.datasets.davinci_tool import DEFAULT_LAW, Tool, ToolSeries, behind
from tenodesis.identification.datasets.reference import Given, Values, without_instrument
from tenodesis.identification.formats.measured import MeasuredRun, Source
from tenodesis.identification.problem import Parameter
from tenodesis.identification.registry import Format
from tenodesis.instrument.joints import MECHANISMS
from tenodesis.run import Array

SOURCE = Source(
    repository=davinci_tool.SOURCE.repository,
    commit=davinci_tool.SOURCE.commit,
    folder="data/Tool_4_Maryland_L_Pitch_1, _3 and _5",
    licence=davinci_tool.SOURCE.licence,
    citation=davinci_tool.SOURCE.citation,
    checksums={
        "pitch+60_000.TXT": "edd6dd7e569c537fff04117bb2804000dce7d928b11824fb6540db3f051df993",
        "pitch+60_001.TXT": "95dd4351a04829b8ec7a8c622af722b22a6b4b2dd440ff47e50bb8f923e1c1b0",
        "pitch+60_002.TXT": "88943dd64cb0fd22184163ea453152a1bae6412d76c9d619a7c79c64a02f6431",
        "pitch+60_003.TXT": "2a25e790ecf3cbcfe24e043d18d225d43dd7e74d11011f91f7ebd4d5890be7a3",
        "pitch-60_000.TXT": "744a6011bd4fb7296ee040bc912a7b6a2b9ef75b940a708bb6f721aa1a7e64d6",
        "pitch-60_001.TXT": "b790213742311b54acdb0f7e76124e9df01edc158536113e522f37eda045e45c",
        "pitch-60_002.TXT": "65b6b3787d160e2b4a0ec273920e11c69ab56d1cdaf4ac581060fca2473c6451",
        "pitch-60_003.TXT": "6dcbcc60125d6ea0142f8927179037c41d5915b1c0f010b2837d0af1685c1309",
        "pitch0_000.TXT": "81d63fdaabdb4b5a3f7c7baf2dc8a41759dfaef2cf8c9a879a2f4d8697bbb2bc",
        "pitch0_001.TXT": "d315c52d6a5500119600639d7820545ff3c37e562b2547ff8b833f1a888f85dd",
        "pitch0_002.TXT": "e788d40ac059404b984ad0713fbda6733b0c0790ed46c8f023b1e34e3d75cc77",
        "pitch0_003.TXT": "20dc842ba6642f9da3dd646c0bf60fbe470627fea844d19411553a923a4518a5",
    },
)
MOST_PITCH = 90
"""Largest pitch that a file's name may have, deg."""
LAWS = tuple(
    name for name, unknown in davinci_tool.LAWS.items() if any(one.name == "friction_exponent" for one in unknown)
)
OFFSET_SHARE = 0.03
"""Share of a recording's mean error that counts: what the model leaves of a mean, over the spread of own offsets."""

_PITCH = re.compile(r"pitch[\s_=]*([+-]?\d+(?:\.\d+)?)", re.IGNORECASE)
_COUPLING = Parameter("coupling", "1", 0.0, -2.0, 2.0, "Jaw angle by pitch, the spindle held", "kinematics")
_RUBS = "Friction exponent at the wrist by the angle of the loaded tendon's wrap"
_FRICTION = Parameter("wrist_friction", "1/rad", 1.0, 0.0, 4.0, _RUBS, "friction")
STRAIGHT_WRAP = math.pi / 2
"""Wrap of the loaded tendon at zero pitch, rad: 1.57 +- 0.06 where it is fitted to recordings at three pitches."""
FAR_SHARE = 0.5
"""Share of the compliance beyond the wrist: 0.49 +- 0.02 where it is fitted to recordings at three pitches."""
_FIRST = {"friction_exponent": 0.2, "pretension": 0.04, "spindle_friction": 0.005}
"""Where the search begins."""


def load(path: Path) -> MeasuredRun:
    """Return a recording of the tool at a pitch; columns as of `davinci_tool.read`, and wrist_pitch (rad).

    Raises IdentificationError as `davinci_tool.read`, and if the file's name has no pitch.
    """
    found = _PITCH.findall(path.stem)
    if len(found) != 1 or abs(float(found[0])) > MOST_PITCH:
        raise IdentificationError(
            f"{path.name}: the name {path.stem!r} is no pitch angle; it must hold one from -{MOST_PITCH} to "
            f"{MOST_PITCH}, in degrees, such as pitch-30_001.TXT",
            key="path",
            value=path,
            allowed=f"named by an angle from -{MOST_PITCH} to {MOST_PITCH}",
        )
    run = davinci_tool.read(path, SOURCE)
    pitch = np.full(len(run), math.radians(float(found[0])))
    notes = (*run.notes, f"pitch {float(found[0]):g} deg, from the file's name")
    return replace(run, columns={**run.columns, "wrist_pitch": pitch}, notes=notes)


class WristedTool(Tool):
    """The tool's model with its wrist, for recordings that have a constant wrist_pitch as well; raises as `Tool`.

    Errors are those beyond each recording's own offset.
    """

    advised = (
        (
            {"coupling", "wrist_friction"},
            "Record the same motion at three or more pitch angles, far apart to either side.",
        ),
        *Tool.advised,
    )

    def __init__(
        self,
        train: Sequence[MeasuredRun],
        test: Sequence[MeasuredRun] = (),
        *,
        law: str = DEFAULT_LAW,
        contacts: int = davinci_tool.CONTACTS,
    ) -> None:
        super().__init__(train, test, law=law, contacts=contacts, laws=LAWS)
        several = len({one.pitch for one in self.fitted[: len(train)]}) > 1
        own = (_COUPLING, _FRICTION) if several else ()
        starts = self._lines(self.fitted[: len(train)], several=several)
        if several:
            # less torque reaches what stretches than the line through the spindle's has
            starts |= {**_FIRST, "compliance": 2 * starts["compliance"]}
        # Against the load the tendon pulls the jaw to -jaw * load; the pitch that draws it moves the jaw there too.
        self._side = -self.jaw * self.load * math.copysign(1.0, starts["coupling"])
        self.parameters = tuple(
            one._replace(start=float(np.clip(starts.get(one.name, one.start), one.lower, one.upper)))
            for one in (*_wide(self.parameters), *own)
        )

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus modelled jaw angle, (n,), with a share of its mean, in deviations of its encoder."""
        return _without_mean(super()._errors(values, self.fitted[run]), OFFSET_SHARE) / self.noise

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals, (n, parameters)."""
        return _without_mean(super().jacobian(values, run), OFFSET_SHARE)

    def modelled(self, values: Values, series: ToolSeries) -> Values:
        """Return the jaw angle by the model without the recording's own offset, (1 + n,), rad."""
        coupling = self.given(values, series).get("coupling", 0.0)
        return np.asarray(super().modelled(values, series) + coupling * series.pitch)

    def _errors(self, values: Array, series: ToolSeries) -> Array:
        return _without_mean(super()._errors(values, series), 0.0)

    def wrap(self, pitch: float) -> float:
        """Return the angle by which the loaded tendon is wrapped at the wrist, rad."""
        wound = _core.joint_wound_bend(MECHANISMS["pulley"], STRAIGHT_WRAP, -self._side)
        return _core.joint_wrap(wound, pitch)

    def _mean(self, given: Given, series: ToolSeries) -> Values:
        """Return the mean torque along the transmission, (n,)."""
        if "wrist_friction" not in given:
            return super()._mean(given, series)
        pretension, start, speed = given["pretension"], given["start"], series.speed
        bearing = {"constant": given.get("spindle_friction", 0.0)}
        near = self._along(given) | {"exponent": given["friction_exponent"]}
        far = near | {"exponent": given["wrist_friction"] * self.wrap(series.pitch)}
        wound = behind("coulomb", bearing, series.torque + pretension, start, speed, slack=True)
        shaft = behind(self.law, near, wound, start, speed, slack=True)
        jaw = behind(self.law, far, shaft, start, speed, slack=True)
        return np.asarray(shaft + FAR_SHARE * (jaw - shaft) - pretension)

    def _lines(self, train: Sequence[ToolSeries], *, several: bool) -> dict[str, float]:
        """Return where the parameters that act without friction start: by a line for each run, side by side."""
        sign, load = self.jaw, self.load
        runs = [(one, np.column_stack([sign * one.spindle, sign * load * one.torque])[one.first :]) for one in train]
        ratio, compliance = np.linalg.lstsq(
            np.vstack([_without_mean(columns, 0.0) for _, columns in runs]),
            np.concatenate([_without_mean(one.reference[one.first :], 0.0) for one, _ in runs]),
        )[0].tolist()
        offsets = [float(np.mean(one.reference[one.first :] - columns @ [ratio, compliance])) for one, columns in runs]
        pitches = [one.pitch for one, _ in runs]
        coupling, offset = np.polyfit(pitches, offsets, 1).tolist() if several else (0.0, float(np.mean(offsets)))
        return {"offset": offset, "ratio": ratio, "compliance": compliance, "coupling": coupling}


def _wide(parameters: Sequence[Parameter]) -> list[Parameter]:
    """Return parameters with bounds that do not depend on a plane through runs at several pitches."""
    bounds = {"offset": (-2 * math.pi, 2 * math.pi), "ratio": (0.1, 5.0), "compliance": (0.0, 10.0)}
    return [
        one._replace(lower=bounds[one.name][0], upper=bounds[one.name][1]) if one.name in bounds else one
        for one in parameters
    ]


def _without_mean(values: Array, share: float) -> Array:
    """Return columns less their means, of which a share stays."""
    return np.asarray(values - (1 - share) * values.mean(axis=0), dtype=np.float64)


problem = without_instrument(WristedTool, "a davinci-posture recording is of a tool without instrument file")
FORMAT = Format(load, problem, laws=LAWS, law=DEFAULT_LAW)
