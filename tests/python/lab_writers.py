"""Files as laboratories write them: columns under headings of a laboratory, in s, deg and N."""

import struct
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from tenodesis.run import Array

from .recording_files import table

Columns = dict[str, Array]


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
