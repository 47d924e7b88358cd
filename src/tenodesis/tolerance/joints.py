"""The responses of a sample of instruments of several joints: the loops of a comparison on the quasi-static twin."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tenodesis._core import Status
from tenodesis.errors import ArgumentError, InstrumentError, StudyError
from tenodesis.instrument import FullForm, Instrument, expanded
from tenodesis.run import Array
from tenodesis.similarity.joints import JointComparison, JointMotions, compare_joints
from tenodesis.statics import up_to_force
from tenodesis.statics.bends import Bends
from tenodesis.tolerance.files import InstrumentName
from tenodesis.tolerance.parameters import UncertainParameter

INVALID = -1
"""Status of a sample that is not a valid instrument."""
_RESPONSES = {
    "loss": "largest loss of angle of {}",
    "loop_width": "loop width of {}",
    "similarity_rms": "similarity of {}, rms",
    "similarity_largest": "similarity of {}, largest",
}
_AT_TIP = {"tip_rms": "at the real-size tip, rms", "tip_largest": "at the real-size tip, largest"}


class JointEvaluation(NamedTuple):
    """The data common to all samples of a study; it can be sent to another machine."""

    real_size: Instrument
    scaled_up: Instrument
    keys: tuple[tuple[InstrumentName, str], ...]
    """Instrument and key of each column of the samples."""
    comparison: JointComparison
    """Of the nominal instruments."""
    motions: JointMotions
    reference: Array | None
    """Angles of the real-size instrument in the loops, (n, loops, joints), rad; None where its samples differ."""
    real_size_force: float
    scaled_up_force: float

    @property
    def end(self) -> float:
        """No handle angle: there are several."""
        return float("nan")

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the responses, by column."""
        joints = self.comparison.joints
        return (*(f"{key}.{joint}" for key in _RESPONSES for joint in joints), *_AT_TIP)

    @property
    def described(self) -> list[tuple[str, str]]:
        """Description and unit of the responses."""
        joints = self.comparison.joints
        by_joint = [(text.format(joint), "deg") for text in _RESPONSES.values() for joint in joints]
        return [*by_joint, *((text, "mm") for text in _AT_TIP.values())]

    def table(self, rows: Array) -> Array:
        """Return responses (NaN where a run was lost) and, as the last column, the status of samples."""
        scaled = [self._built("scaled-up", row) for row in rows]
        found, status = self._angles(scaled, scaled_up=True)
        if self.reference is None:
            expected, other = self._angles([self._built("real-size", row) for row in rows], scaled_up=False)
            status = np.where(status == Status.OK, other, status)
        else:
            expected = self.reference
        table = np.full((len(rows), len(self.responses)), np.nan)
        held = status == Status.OK
        if held.any():
            table[held] = self._responses(found[held], expected if self.reference is not None else expected[held])
        return np.column_stack([table, status])

    def _responses(self, found: Array, expected: Array) -> Array:
        bends = Bends.of(self.comparison.real_size)
        angles = np.degrees(bends.summed(found))
        loads = 1 + len(self.comparison.loads)
        joints = angles.shape[-1]
        # Of each motion: its loads, of which the first is none.
        by_motion = angles.reshape(len(angles), angles.shape[1], -1, loads, joints)
        lost = np.abs(by_motion - by_motion[:, :, :, :1]).max(axis=(1, 2, 3))
        flexion, extension = self.motions.last_loop
        width = np.abs(by_motion[:, extension][:, ::-1, :, 0] - by_motion[:, flexion][:, :, :, 0]).mean(axis=1)
        errors = self.comparison.between_many(found, expected)
        at_tip = [(1e3 * one.rms_at_tip, 1e3 * one.largest_at_tip) for one in errors]
        return np.column_stack(
            [lost, width.max(axis=1), [one.rms for one in errors], [one.largest for one in errors], at_tip]
        )

    def _angles(self, insts: Sequence[FullForm | None], *, scaled_up: bool) -> tuple[Array, Array]:
        """Return the angles in the loops, (instruments, n, loops, joints), rad, and the status of each instrument."""
        angles = self.motions.angles(insts, scaled=scaled_up)
        status = np.where(np.isnan(angles).any(axis=(1, 2, 3)), int(Status.NO_EQUILIBRIUM), int(Status.OK))
        status[[inst is None for inst in insts]] = INVALID
        return angles, status

    def _built(self, which: InstrumentName, row: Array) -> FullForm | None:
        inst = self.real_size if which == "real-size" else self.scaled_up
        changes = {key: float(value) for (of, key), value in zip(self.keys, row, strict=True) if of == which}
        try:
            return expanded(inst.replace(**changes) if changes else inst)
        except InstrumentError:
            return None


def joint_evaluation(
    real_size: Instrument, scaled_up: Instrument, parameters: tuple[UncertainParameter, ...], force: float | None
) -> JointEvaluation:
    """Return the data common to all samples, once the nominal instruments have held the loads.

    Raises StudyError if they have not the same joints and tendons, the second is the smaller, or they do not hold the
    loads.
    """
    try:
        pair = compare_joints(real_size, scaled_up)
        if force is not None:
            pair = compare_joints(real_size, scaled_up, loads=up_to_force(pair.loads, force))
    except ArgumentError as problem:
        raise StudyError(str(problem), key="scaled_up", value=scaled_up.name) from None
    if pair.length_factor < 1:
        raise StudyError(
            f"{real_size.name} is larger than {scaled_up.name}, whose joints have {pair.length_factor:.3g} of its "
            "size; the real-size instrument comes first, the scaled-up one second.",
            key="real_size",
            value=real_size.name,
        )
    size = max((one.size for one in pair.loads if one.wrench.any()), default=0.0)
    both = any(one.instrument == "real-size" for one in parameters)
    reference = pair.motions.angles([pair.real_size])
    task = JointEvaluation(
        real_size,
        scaled_up,
        tuple((one.instrument, one.key) for one in parameters),
        pair,
        pair.motions,
        None if both else reference[0],
        size,
        size * pair.factors["force"],
    )
    nominal = pair.motions.angles([pair.scaled_up], scaled=True)
    for inst, angles, own in ((real_size, reference, size), (scaled_up, nominal, task.scaled_up_force)):
        if np.isnan(angles).any():
            lost = next(
                name for name, row in zip(pair.motions.names, np.isnan(angles[0]).any(axis=(0, 2)), strict=True) if row
            )
            raise StudyError(
                f"{inst.name} as in its file does not hold {own:.4g} N while {lost} is bent through its range "
                f"({size:.4g} N on {real_size.name}); use a smaller force or more pretension.",
                key="force",
                value=size,
            )
    return task
