"""The command line as `python -m tenodesis.cli`."""

from tenodesis.cli.commands import main

main()
