"""The table of commands, and the overview that is printed from it without importing a command."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple


class Entry(NamedTuple):
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


class EntryGroup(NamedTuple):
    """A command that has commands of its own."""

    help: str
    commands: "Mapping[str, Entry | EntryGroup]"
    default: Entry | None = None
    """Runs where no command is named."""


PANELS: dict[str, dict[str, Entry | EntryGroup]] = {
    "Describe": {"new": Entry("new.new"), "check": Entry("instrument.check"), "schema": Entry("instrument.schema")},
    "Analyse": {
        "loss": Entry("loss.loss"),
        "bench": Entry("bench.bench"),
        "compare": Entry("compare.compare"),
        "vertices": Entry("vertices.study_vertices"),
    },
    "Record and control": {
        "record": Entry("recording.record"),
        "info": Entry("recording.info"),
        "map": Entry("map.write_map"),
        "replay": Entry("recording.replay"),
        "console": Entry("live.live_console"),
        "link": Entry("live.link"),
        "foxglove": Entry("live.foxglove"),
        "devices": EntryGroup(
            "List devices, or test a device.", {"test": Entry("devices.test_device")}, Entry("devices.list_devices")
        ),
    },
    "Identify": {
        "plan-identification": Entry("plan_identification.plan_identification"),
        "identify": Entry("identify.identify"),
        "force": Entry("force.force"),
    },
    "Scale and build": {
        "scale": Entry("scale.scale"),
        "tolerance": Entry("tolerance.study_tolerances"),
        "cad": Entry("cad.write_cad"),
        "transfer": Entry("transfer.transfer"),
    },
    "Exchange": {
        "import": EntryGroup("Read what other programs describe.", {"dvrk": Entry("import_tool.import_dvrk")}),
        "export": EntryGroup(
            "Write what other programs read.",
            {
                "recording": Entry("recording.export_recording"),
                "controller": Entry("export.export_controller"),
                "urdf": Entry("export.export_urdf"),
                "mjcf": Entry("export.export_mjcf"),
            },
        ),
    },
}
"""The commands by what people do."""
COMMANDS: dict[str, Entry | EntryGroup] = {
    name: command for panel in PANELS.values() for name, command in panel.items()
}
ALL = EntryGroup(
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


def print_overview(usage: str, group: EntryGroup) -> None:
    """Print the help of a group of commands without what typer loads for it."""
    options = OPTIONS if group is ALL else {}
    panels = {"Options": [*options.items(), (", ".join(HELP_OPTIONS), "Show this message and exit.")]}
    for title, commands in (PANELS if group is ALL else {"Commands": group.commands}).items():
        panels[title] = [(name, command.help) for name, command in commands.items()]
    print_help(usage, group.help, panels)


def print_help(usage: str, about: str, panels: Mapping[str, Iterable[tuple[str, str]]]) -> None:
    """Print a help: panels of names, which are never broken, and what each is."""
    from rich.console import Console  # noqa: PLC0415
    from rich.padding import Padding  # noqa: PLC0415
    from rich.panel import Panel  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    console = Console(highlight=False)
    console.print(Padding(Text.assemble((" Usage: ", "yellow"), (usage, "bold")), (1, 0)))
    console.print(Padding(Text(about), (0, 1, 1, 1)))
    for title, rows in panels.items():
        table = Table(box=None, show_header=False, expand=True, pad_edge=False, highlight=False)
        table.add_column(style="bold cyan", no_wrap=True)
        table.add_column(ratio=10)
        for name, description in rows:
            table.add_row(name, Text(description))
        console.print(Panel(table, title=title, title_align="left", border_style="dim"))
    console.print()
