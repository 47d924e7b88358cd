"""A run of ten minutes in the files that laboratories write: each shown, mapped, identified from and drawn.

    python studies/files.py [--seconds 600] [--rate 250] [--kinds .lvm .tdms]

The twin of the scaled-up instrument runs at 2 kHz; its readings are written at the rate given, with 17 digits in texts,
in the degrees and newtons of a laboratory. `info`, `map` and `identify` are commands, `plot` is tenodesis.plot.run of
what Recording.open reads. Prints what each took, and how far the parameters are from those of the export's columns.
"""

import argparse
import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

import tenodesis as tn
from tenodesis.simulate import Cycles, Protocol

Array = NDArray[np.float64]
Columns = dict[str, Array]
"""Columns of a laboratory by its headings, in s, deg and N."""

HEADINGS = {
    "commanded_handle_angle": "theta_h",
    "measured_tension.agonist": "F1",
    "measured_tension.antagonist": "F2",
    "measured_output_angle": "theta_e",
    "force": "load",
}
FITTED = "friction,stiffness_ratio,pretension"
INSTRUMENT = "scaled-up"


def table(path: Path, columns: Columns, separator: str = ",", cell: Callable[[float], str] = repr) -> Path:
    """Write a text, with an empty cell for what is not known."""
    rows = np.column_stack([*columns.values()]).tolist()
    lines = (separator.join(cell(one) if isfinite(one) else "" for one in row) for row in rows)
    path.write_text("\n".join([separator.join(columns), *lines]) + "\n")
    return path


def comma(value: float) -> str:
    """Return a number with a decimal comma."""
    return repr(value).replace(".", ",")


def german(path: Path, columns: Columns) -> None:
    """Write what a German Excel exports."""
    words = {"t": "Zeit", "theta_h": "Griff", "theta_e": "Spitze", "load": "Last"}
    table(path, {words.get(name, name): values for name, values in columns.items()}, ";", comma)


def milliseconds(path: Path, columns: Columns) -> None:
    """Write a text whose clock is in ms."""
    table(path, {"t [ms]": 1e3 * columns["t"], **{name: columns[name] for name in list(columns)[1:]}})


def stamped(path: Path, columns: Columns) -> None:
    """Write a text with a clock in two columns."""
    nanoseconds = np.round(columns["t"] * 1e9) + 999_500_000
    clock = {"sec": 1.7e9 + nanoseconds // 1e9, "nanosec": nanoseconds % 1e9}
    table(path, clock | {name: values for name, values in columns.items() if name != "t"})


def lvm(path: Path, columns: Columns, *, x: bool = True) -> None:
    """Write a LabVIEW measurement with a decimal comma, its clock as a column or in its header alone."""
    header = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t,", "***End_of_Header***\t", "\t"]
    count = len(columns) - 1
    step = comma(float(columns["t"][1] - columns["t"][0]))
    header += [f"Channels\t{count}", "X0" + "\t0" * count, "Delta_X" + f"\t{step}" * count]
    header += ["***End_of_Header***", "\t".join(["X_Value", *list(columns)[1:], "Comment"])]
    rows = [
        "\t".join([comma(time) if x else "", *map(comma, rest), ""])
        for time, *rest in np.column_stack([*columns.values()]).tolist()
    ]
    path.write_text("\n".join([*header, *rows]) + "\n")


def tdms(path: Path, columns: Columns, *, waveform: bool = False) -> None:
    """Write LabVIEW's binary file, its clock as a channel or as a property of each."""
    about = {"wf_increment": float(columns["t"][1] - columns["t"][0]), "wf_start_offset": 0.0}
    names = list(columns)[1:] if waveform else list(columns)
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("bench", name, columns[name], about if waveform else {}) for name in names])


def structure(path: Path, columns: Columns) -> None:
    """Write a structure of MATLAB."""
    scipy.io.savemat(path, {"bench": columns})


def mat73(path: Path, columns: Columns) -> None:
    """Write a structure as MATLAB does since 7.3."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in columns.items():
            file[f"bench/{name}"] = values[np.newaxis]
    with path.open("r+b") as start:
        start.write(b"MATLAB 7.3 MAT-file".ljust(124) + struct.pack("<H", 0x0200) + b"IM")


def hdf5(path: Path, columns: Columns) -> None:
    """Write HDF5 as h5py does."""
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = values


def arrays(path: Path, columns: Columns) -> None:
    """Write an archive of NumPy."""
    np.savez(path, **columns)


def xlsx(path: Path, columns: Columns) -> None:
    """Write a sheet of Excel."""
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet()
    sheet.append(list(columns))
    for row in np.column_stack([*columns.values()]).tolist():
        sheet.append(row)
    book.save(path)


JOINTS = {
    "/MTM/setpoint_js": ("position", ("theta_h",)),
    "/MTM/measured_js": ("position", ("theta_m",)),
    "/PSM/output/measured_js": ("position", ("theta_e",)),
    "/PSM/tendons/measured_js": ("effort", ("F1", "F2")),
}
"""Topics of a robot's controller: the field that is filled, and the columns of its joints."""
WRENCH = "/PSM/tip/measured_cf"


def bag(path: Path, columns: Columns, *, storage: str = "", shifted: float = 0.0) -> Path:
    """Write a bag as a robot's controller would: ROS 1, or ROS 2 by a storage plugin; the wrench may come later."""
    store = get_typestore(Stores.ROS2_HUMBLE if storage else Stores.ROS1_NOETIC)
    types = store.types
    joint_state, wrench_stamped = types["sensor_msgs/msg/JointState"], types["geometry_msgs/msg/WrenchStamped"]
    number = {} if storage else {"seq": 0}

    def header(time: float) -> tuple[int, object]:
        stamp = 1_700_000_000_000_000_000 + round(time * 1e9)
        clock = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return stamp, types["std_msgs/msg/Header"](stamp=clock, frame_id="base", **number)

    def write(writer: object, kind: str, topic: str, messages: Iterable[tuple[tuple[int, object], object]]) -> None:
        connection = writer.add_connection(topic, kind, typestore=store)  # type: ignore[attr-defined]
        pack = store.serialize_cdr if storage else store.serialize_ros1
        for (stamp, _), message in messages:
            writer.write(connection, stamp, pack(message, kind))  # type: ignore[attr-defined]

    made = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage]) if storage else None
    heads = [header(time) for time in columns["t"].tolist()]
    with made or rosbag1.Writer(path) as writer:
        for topic, (field, names) in JOINTS.items():
            if any(name not in columns for name in names):
                continue
            rows = np.stack([np.radians(columns[name]) if field == "position" else columns[name] for name in names], 1)
            arrays = dict.fromkeys(("position", "velocity", "effort"), np.empty(0))
            joints = [f"wire_{at}" for at in (1, 2)] if names[1:] else ["jaw"]
            messages = (
                (head, joint_state(header=head[1], name=joints, **arrays | {field: row}))
                for head, row in zip(heads, rows, strict=True)
            )
            write(writer, "sensor_msgs/msg/JointState", topic, messages)
        vector, wrench = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Wrench"]
        messages = (
            (
                head,
                wrench_stamped(
                    header=head[1],
                    wrench=wrench(force=vector(x=force, y=0.0, z=0.0), torque=vector(x=0.0, y=0.0, z=0.0)),
                ),
            )
            for head, force in zip(
                [header(one) for one in (columns["t"] + shifted).tolist()], columns["load"].tolist(), strict=True
            )
        )
        write(writer, "geometry_msgs/msg/WrenchStamped", WRENCH, messages)
    return path


def recording(run: tn.Run, path: Path) -> None:
    """Write a recording of ours."""
    with tn.Recorder(path, axes=run.axes) as recorder:
        recorder.write(run)


KINDS: dict[str, Callable[[Path, Columns], object]] = {
    "comma.csv": table,
    "german.csv": german,
    "tabs.txt": partial(table, separator="\t"),
    "milliseconds.csv": milliseconds,
    "stamped.csv": stamped,
    "bench.lvm": lvm,
    "no_x.lvm": partial(lvm, x=False),
    "bench.tdms": tdms,
    "waveform.tdms": partial(tdms, waveform=True),
    "bench.mat": scipy.io.savemat,
    "structure.mat": structure,
    "newer.mat": mat73,
    "bench.h5": hdf5,
    "bench.npz": arrays,
    "bench.xlsx": xlsx,
    "run.bag": bag,
    "run_db3": partial(bag, storage="SQLITE3"),
    "run_mcap": partial(bag, storage="MCAP"),
}
"""What laboratories write, by the file's name."""
OWN: dict[str, Callable[[tn.Run, Path], object]] = {
    "export.csv": tn.recording.to_csv,
    "export.parquet": tn.recording.to_parquet,
    "recording.mcap": recording,
}
"""What this package writes; the first is what the others are compared with."""


def recorded(seconds: float, rate: float) -> tn.Run:
    """Return what a laboratory has of a run: commanded handle, tensions, tip and force, so many times a second."""
    period = 4.0
    protocol = Protocol(
        name="files",
        phases=tuple(
            Cycles(amplitude=np.radians(35), symmetric=True, period=period, count=1, force=force)
            for _, force in zip(range(round(seconds / period)), [0.0, 0.5, 1.0] * round(seconds), strict=False)
        ),
    )
    run = tn.simulate.execute(tn.twin.Twin(tn.load(INSTRUMENT), seed=3), protocol)
    run = run.rows(step=round(1 / (rate * (run.time[1] - run.time[0])))).axis(run.axes[0])
    wanted = {name.partition(".")[0] for name in HEADINGS}
    return replace(run, **{name: None for name in run.signals() if name not in wanted})


def laboratory(run: tn.Run) -> Columns:
    """Return a run under the headings of a laboratory, angles in degrees."""
    found = {"t": run.time - run.time[0]}
    for name, short in HEADINGS.items():
        found[short] = np.degrees(run[name]) if name.endswith("angle") else run[name]
    return found


def command(*arguments: object) -> tuple[float, str]:
    """Return the seconds that a command took, NaN if it failed, and what it printed; raises after ten minutes."""
    begun = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "tenodesis.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    if done.returncode:
        print(f"{' '.join(map(str, arguments))}: exit code {done.returncode}: {(done.stderr or done.stdout)[-600:]}")
    return (np.nan if done.returncode else time.monotonic() - begun), done.stdout


def drawn(path: Path) -> float:
    """Return the seconds that it took to read and draw a file."""
    begun = time.monotonic()
    try:
        run = tn.Recording.open(path).run
        tn.plot.run(run, ["measured_tension", "measured_output_angle"]).savefig(
            path.with_name(f"{path.name}.drawn.png")
        )
    except tn.Error as problem:
        print(problem)
        return np.nan
    return time.monotonic() - begun


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rate", type=float, default=250.0)
    parser.add_argument("--kinds", nargs="+", default=[])
    given = parser.parse_args()
    run = recorded(given.seconds, given.rate)
    columns = laboratory(run)
    print(f"{len(run)} rows over {run.time[-1] - run.time[0]:.5g} s; seconds of each command, - where it failed")
    print(f"{'file':18}{'MB':>7}{'info':>7}{'map':>7}{'identify':>10}{'plot':>7}  parameters from those of the export")
    reference: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        writers = {one: partial(write, run) for one, write in OWN.items()}
        writers |= {one: lambda path, write=write: write(path, columns) for one, write in KINDS.items()}
        for kind, write in writers.items():
            if reference and given.kinds and not any(one in kind for one in given.kinds):
                continue
            path = folder / kind
            write(path)
            size = sum(one.stat().st_size for one in (path.rglob("*") if path.is_dir() else [path])) / 1e6
            shown, _ = command("info", path)
            mapped, _ = command("map", path)
            fitted, said = command(
                "identify",
                path,
                "--instrument",
                INSTRUMENT,
                "--fit",
                FITTED,
                "--starts",
                1,
                "--out",
                folder / "out",
                "--json",
                "--overwrite",
            )
            given_back = json.loads(said)["parameters"] if said else {}
            values = {one: about["value"] for one, about in given_back.items() if about["fitted"]}
            reference = reference or values
            off = max((abs(values[one] / reference[one] - 1) for one in values), default=np.nan)
            cells = "".join(
                f"{one:{width}.1f}" if np.isfinite(one) else f"{'-':>{width}}"
                for one, width in zip((shown, mapped, fitted, drawn(path)), (7, 7, 10, 7), strict=True)
            )
            print(f"{kind:18}{size:7.1f}{cells}  {off:.1g}", flush=True)


if __name__ == "__main__":
    main()
