"""The command line: parse, call, print."""

from __future__ import annotations

import sys

from fieldlink.cli.early_signals import heed_early_signals

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit."""
    heed_early_signals(sys.argv)
    # Here, because it takes a while, and signals are heeded meanwhile.
    from fieldlink.cli.app import main as run

    run()
