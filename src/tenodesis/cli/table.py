"""The table of commands, and the overview that is printed from it without importing a command."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple


class Command(NamedTuple):
    """A command of the command line."""

    help: str
    """First line of its docstring, which a test holds."""
    function: str
    """MODULE.FUNCTION within this package"""


class Group(NamedTuple):
    """A command that has commands of its own."""

    help: str
    commands: "Mapping[str, Command | Group]"
    default: Command | None = None
    """Runs where no command is named."""


EXPORTS = {
    "recording": Command(
        "Write a recording's signals as a table, with a column for each signal of each axis or tendon, in SI units.",
        "recording.export_recording",
    ),
    "controller": Command(
        "Write a controller's parameters as a C header, for tenodesis_init.", "export.export_controller"
    ),
    "urdf": Command(
        "Write an instrument as a URDF robot: links, joints, mimics; no tendons. Says what is missing.",
        "export.export_urdf",
    ),
    "mjcf": Command(
        "Write an instrument as a MuJoCo model: bodies, tied joints, tendons. Says what is missing.",
        "export.export_mjcf",
    ),
}
IMPORTS = {
    "dvrk": Command(
        "Write an instrument from a tool file of the da Vinci Research Kit, with the file's coupling matrix.",
        "import_tool.import_dvrk",
    ),
}
DEVICES = {
    "test": Command(
        "Measure a device's rate, jitter and losses, with the motors at rest; exit code 1 if the controller needs "
        "more.",
        "devices.test_device",
    ),
}
COMMANDS: dict[str, Command | Group] = {
    "new": Command(
        "Write a commented instrument file from a mechanism and six numbers, asking for what no option gives.",
        "new.new",
    ),
    "loss": Command(
        "Print the angle that loads take at the tip, what restores it, and the load at which a tendon goes slack.",
        "loss.loss",
    ),
    "bench": Command(
        "Compute a report on an instrument, every figure of the paper for its own, and write out/report.html.",
        "bench.bench",
    ),
    "schema": Command(
        "Print the JSON schema of a kind of file, for editors that complete and check TOML.", "instrument.schema"
    ),
    "check": Command(
        "Check an instrument file; print its values, what follows from them, and what is implausible about it.",
        "instrument.check",
    ),
    "record": Command(
        "Run a protocol on the twin of an instrument and record it, with --law under a controller.",
        "recording.record",
    ),
    "info": Command(
        "Print the contents of recordings: origin, topics, ranges of the signals, and events.",
        "recording.info",
    ),
    "replay": Command(
        "Run a recording's commands again and print how the twin differs from the recording.", "recording.replay"
    ),
    "scale": Command(
        "Design a scale model of an instrument from stock parts: instrument file, test plan, and how similar it is.",
        "scale.scale",
    ),
    "cad": Command(
        "Write an instrument on its bench as solids: STEP, STL, glTF, drawings, pictures; checked over its range.",
        "cad.write_cad",
    ),
    "transfer": Command(
        "Carry a recording of a scaled-up instrument to real-size units, and its friction to the real-size file.",
        "transfer.transfer",
    ),
    "tolerance": Command(
        "Study what tolerances do to a scale model's loss of angle and similarity, and which of them dominate.",
        "tolerance.study_tolerances",
    ),
    "vertices": Command(
        "Study rounder vertices: radius, coefficient and rope against loss, hysteresis and final errors.",
        "vertices.study_vertices",
    ),
    "identify": Command(
        "Identify a model from recordings: parameters with intervals, errors on held-out runs, and the instrument "
        "file.",
        "identify.identify",
    ),
    "force": Command(
        "Estimate torque and angle of a tool's jaw from its spindle's angle and torque, or motor current.",
        "force.force",
    ),
    "plan-identification": Command(
        "Propose the bench protocol that makes parameters identifiable, and predict their precision.",
        "plan_identification.plan_identification",
    ),
    "console": Command(
        "Open the live instrument in the browser: move its handle, push on its tip, switch the compensation on and "
        "off.",
        "live.live_console",
    ),
    "link": Command(
        "Print the link that opens the page of the console that runs here, its token included.", "live.link"
    ),
    "foxglove": Command(
        "Show a live instrument to Foxglove: the recordings' topics over a WebSocket, read-only.",
        "live.foxglove",
    ),
    "export": Group("Write what other programs read.", EXPORTS),
    "import": Group("Read what other programs describe.", IMPORTS),
    "devices": Group(
        "List devices, or test a device.",
        DEVICES,
        Command("List the devices and what each needs.", "devices.list_devices"),
    ),
}
ALL = Group(
    "Model, scale, test and control tendon-driven hand-held surgical instruments. Research software, not a medical "
    "device.",
    COMMANDS,
)


HELP_OPTIONS = ("-h", "--help")
VERSION_OPTION = "--version"
OPTIONS = {
    VERSION_OPTION: "Print the version.",
    "--quiet, -q": "Print results, warnings and errors only; every command has this.",
    "--install-completion": "Install completion for the current shell.",
    "--show-completion": "Print completion for the current shell, to copy or adapt it.",
}
"""Options beside the commands."""


def print_overview(usage: str, group: Group) -> None:
    """Print the help of a group of commands, as typer prints that of a command, without what that loads."""
    from rich.console import Console  # noqa: PLC0415
    from rich.padding import Padding  # noqa: PLC0415
    from rich.panel import Panel  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    def panel(title: str, rows: Iterable[tuple[str, ...]]) -> Panel:
        table = Table(box=None, show_header=False, expand=True, pad_edge=False, highlight=False)
        table.add_column(style="bold cyan", no_wrap=True)
        table.add_column(ratio=10)
        for name, description in rows:
            table.add_row(name, Text(description))
        return Panel(table, title=title, title_align="left", border_style="dim")

    console = Console(highlight=False)
    console.print(Padding(Text.assemble((" Usage: ", "yellow"), (usage, "bold")), (1, 0)))
    console.print(Padding(Text(group.help), (0, 1, 1, 1)))
    options = OPTIONS if group is ALL else {}
    console.print(panel("Options", [*options.items(), (", ".join(HELP_OPTIONS), "Show this message and exit.")]))
    console.print(panel("Commands", [(name, command.help) for name, command in group.commands.items()]))
    console.print()
