"""The command line."""

from egosplat.cli.commands import cli, main

__all__ = ["cli", "main"]
