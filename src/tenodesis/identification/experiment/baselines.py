"""What a bench would do without a plan, in the same time."""

from collections.abc import Sequence

from tenodesis import statics
from tenodesis.errors import NoSolutionError
from tenodesis.identification.experiment.candidates import Phase
from tenodesis.instrument import Instrument
from tenodesis.simulate import Cycles, Hold, Ramp
from tenodesis.simulate.reach import largest

_LOADING, _RESTING = 0.5, 0.25
_CYCLES = 2
_PLAIN_PERIOD = 6.6
"""Of the plain cycles, s: those of the paper's Fig. 14 at 10 deg/s on its scaled-up instrument."""


def baselines(inst: Instrument, forces: Sequence[float], duration: float) -> dict[str, tuple[Phase, ...]]:
    """Return protocols by name: plain cycles without load, and the paper's cycles of Fig. 14.

    Parameters
    ----------
    inst
        The instrument, of one axis.
    forces
        Forces at the tip of the paper's cycles, N; without any they are left out.
    duration
        How long each lasts, s, as near as whole cycles allow.
    """
    try:
        amplitude = min(statics.reach(inst), largest(inst))
    except NoSolutionError:
        amplitude = largest(inst)
    count = max(1, round(duration / _PLAIN_PERIOD))
    found: dict[str, tuple[Phase, ...]] = {
        "plain cycles": (Cycles(amplitude=amplitude, period=duration / count, count=count),)
    }
    each = duration / max(1, len(forces)) - _LOADING - _RESTING
    if forces and each > 0:
        loaded = [
            (
                Ramp(force=force, duration=_LOADING),
                Hold(duration=_RESTING),
                Cycles(amplitude=amplitude, period=each / _CYCLES, count=_CYCLES),
            )
            for force in forces
        ]
        found["the paper's cycles"] = tuple(phase for phases in loaded for phase in phases)
    return found
