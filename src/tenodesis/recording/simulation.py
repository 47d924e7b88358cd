"""Record a twin: a protocol while it runs, or a run simulated before."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tenodesis.control import Controller, JointController
from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument, InstrumentLike, as_instrument
from tenodesis.recording.metadata import metadata_of
from tenodesis.recording.writer import Recorder
from tenodesis.run import TISSUE, Run, concatenate
from tenodesis.simulate import Pretension, Protocol
from tenodesis.simulate.execution import blocks, check_controllable, without_control
from tenodesis.twin import TIME_STEP, Twin

_LEAST_SLACK = 2e-3
"""Least length by which the motors let tendons out, m."""
_SLACKENING = 1.25
"""What they let out over the stretch of the tendons at rest, so that all of them are slack."""


def record(
    inst: InstrumentLike,
    protocol: Protocol,
    path: str | Path,
    *,
    controller: Controller | JointController | None = None,
    time_step: float = TIME_STEP,
    seed: int = 0,
    quasi_static: bool = False,
    every: int = 1,
    home: bool = False,
    overwrite: bool = False,
    progress: Callable[[float, float], object] | None = None,
    each: Callable[[Run], object] | None = None,
) -> Run:
    """Run a protocol on the twin of an instrument, and record it while it runs.

    A protocol that begins with a pretension phase finds slack tendons: the motors let them out first, which is recorded
    as well, and a controller homes them; it starts to run after that. The whole run is returned, which at 2 kHz takes
    2 MB a second, unless `each` takes its blocks.

    Parameters
    ----------
    inst
        The instrument.
    protocol
        The protocol; all of it is checked before the file is opened.
    path
        The file.
    controller
        Closes the loop, as for :func:`tenodesis.simulate.execute`; it is reset first.
    time_step, seed, quasi_static
        As for :class:`tenodesis.twin.Twin`.
    every
        Of how many rows one is written, the first and on; such a file cannot be replayed.
    home
        Whether the controller homes before the protocol, or after the pretension phase that it begins with.
    overwrite
        Whether to replace a file that exists.
    progress
        Called after every block with the seconds done and those of the entire run. An exception that it raises ends the
        run; the file contains the blocks before it.
    each
        Called with every block once it is written; no block is kept then but the last.

    Returns
    -------
    Run
        What was run, all of its rows; with `each` the last block.

    Raises
    ------
    ProtocolError
        The instrument, or the controller, cannot run the protocol, or a tendon does not get tight.
    RecordingError
        The file cannot be written, or exists.
    NoSolutionError
        The tip was loaded beyond what it can hold; the file contains the blocks before.
    ValueError
        The twin cannot have this time step or seed, or the controller is for other axes or joints.
    """
    inst = as_instrument(inst)
    if every < 1:
        raise RecordingError(key="every", value=every, allowed="1 or more")
    if home and controller is None:
        raise RecordingError(key="home", value=home, allowed="left out where there is no controller")
    twin = Twin(inst, time_step=time_step, seed=seed, quasi_static=quasi_static)
    plan = protocol.plan(inst, time_step)
    if controller is not None:
        controller.reset()
        controller.check_instrument(inst)
        check_controllable(plan, inst, controller.inst)
    metadata = metadata_of(
        inst, protocol, seed=seed, time_step=time_step, quasi_static=quasi_static, controller=controller, every=every
    )
    names = controller.names_of(inst) if isinstance(controller, JointController) else twin.names
    with Recorder(path, axes=names, metadata=metadata, overwrite=overwrite) as recorder:
        rows = 0
        kept: list[Run] = []
        for run in _blocks(twin, protocol, controller, progress, home=home):
            recorder.write(run.rows(-rows % every, None, every))
            rows += len(run)
            kept.append(run)
            if each is not None:
                each(run)
                del kept[:-1]
    return concatenate(kept)


def _blocks(
    twin: Twin,
    protocol: Protocol,
    controller: Controller | JointController | None,
    progress: Callable[[float, float], object] | None,
    *,
    home: bool,
) -> Iterator[Run]:
    """Yield the run of a protocol, before which the motors let tendons out that it is to pretension."""
    if isinstance(protocol.phases[0], Pretension):
        loosened = twin.loosen(max(_LEAST_SLACK, _SLACKENING * twin.stretch))
        loosened = without_tissue(loosened) if protocol.has_tissue else loosened
        yield loosened if controller is None else without_control(loosened, controller)
    yield from blocks(twin, protocol, controller, home=home, progress=progress)


def write_run(
    run: Run,
    inst: Instrument,
    path: str | Path,
    *,
    protocol: Protocol | None = None,
    controller: Controller | JointController | None = None,
    time_step: float = TIME_STEP,
    seed: int = 0,
    quasi_static: bool = False,
    overwrite: bool = False,
) -> None:
    """Write a run simulated before, as the same file that :func:`record` would write while it runs.

    Parameters
    ----------
    run
        The run.
    inst, protocol, controller
        What was run: the instrument, the protocol if the run followed one, and the controller if one closed the loop.
    time_step, seed, quasi_static
        Of the twin that made the run.
    path, overwrite
        As for :func:`record`.

    Raises
    ------
    RecordingError
        The file cannot be written, or exists, or the run has other axes, joints or tendons than the instrument.
    """
    metadata = metadata_of(
        inst, protocol, seed=seed, time_step=time_step, quasi_static=quasi_static, controller=controller
    )
    with Recorder(path, axes=run.names, metadata=metadata, overwrite=overwrite) as recorder:
        recorder.write(run)


def without_tissue(run: Run) -> Run:
    """Return a run with the signals of tissue that is not there."""
    absent: dict[str, Any] = {name: np.zeros(run.names.shape(name, len(run))) for name in TISSUE}
    return replace(run, **absent)
