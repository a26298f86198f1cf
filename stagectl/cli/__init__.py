"""The command line: one module a group of verbs, each thin: read, call, show."""

from stagectl.cli.app import main

__all__ = ["main"]
