"""The command line: a module per command, joined in commands."""
