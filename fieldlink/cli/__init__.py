"""The command line: parse, call, print."""

from fieldlink.cli.app import main

__all__ = ["main"]
