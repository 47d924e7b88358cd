"""The table of commands, and the overview that is printed from it without importing a command."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple


class Command(NamedTuple):
    """A command of the command line."""

    function: str
    """MODULE.FUNCTION within this package"""

    @property
    def help(self) -> str:
        """First line of its docstring, read without an import of its module."""
        module, _, name = self.function.partition(".")
        text = Path(__file__).with_name(f"{module}.py").read_text("utf-8")
        found = re.search(rf'^def {name}\(.*?^    """([^\n"]+)', text, re.DOTALL | re.MULTILINE)
        return "" if found is None else found[1]


class Group(NamedTuple):
    """A command that has commands of its own."""

    help: str
    commands: "Mapping[str, Command | Group]"
    default: Command | None = None
    """Runs where no command is named."""


PANELS: dict[str, dict[str, Command | Group]] = {
    "Describe": {
        "new": Command("new.new"),
        "check": Command("instrument.check"),
        "schema": Command("instrument.schema"),
    },
    "Analyse": {
        "loss": Command("loss.loss"),
        "bench": Command("bench.bench"),
        "vertices": Command("vertices.study_vertices"),
    },
    "Record and control": {
        "record": Command("recording.record"),
        "info": Command("recording.info"),
        "replay": Command("recording.replay"),
        "console": Command("live.live_console"),
        "link": Command("live.link"),
        "foxglove": Command("live.foxglove"),
        "devices": Group(
            "List devices, or test a device.",
            {"test": Command("devices.test_device")},
            Command("devices.list_devices"),
        ),
    },
    "Identify": {
        "plan-identification": Command("plan_identification.plan_identification"),
        "identify": Command("identify.identify"),
        "force": Command("force.force"),
    },
    "Scale and build": {
        "scale": Command("scale.scale"),
        "tolerance": Command("tolerance.study_tolerances"),
        "cad": Command("cad.write_cad"),
        "transfer": Command("transfer.transfer"),
    },
    "Exchange": {
        "import": Group("Read what other programs describe.", {"dvrk": Command("import_tool.import_dvrk")}),
        "export": Group(
            "Write what other programs read.",
            {
                "recording": Command("recording.export_recording"),
                "controller": Command("export.export_controller"),
                "urdf": Command("export.export_urdf"),
                "mjcf": Command("export.export_mjcf"),
            },
        ),
    },
}
"""The commands by what people do."""
COMMANDS: dict[str, Command | Group] = {name: command for panel in PANELS.values() for name, command in panel.items()}
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
    for title, commands in (PANELS if group is ALL else {"Commands": group.commands}).items():
        console.print(panel(title, [(name, command.help) for name, command in commands.items()]))
    console.print()
