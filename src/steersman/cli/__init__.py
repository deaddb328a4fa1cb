"""The command line: thin commands over the library; nothing heavy is imported at the start."""

from steersman.cli.app import app, main

__all__ = ["app", "main"]
