"""The command line: parse, call, print.

No rule about writing, no protocol and no numerics: a command calls the package that has them.
"""

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
