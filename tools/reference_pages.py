"""Write the pages of docs/reference that come from the program itself.

    python -m tools.reference_pages [--out docs/reference]

The command line comes from its help, the keys of site files and scenarios from their models, the
metrics from the daemon. A test compares the pages in docs/reference with these.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tools.block_page import block_page
from tools.command_page import command_page
from tools.key_pages import scenario_keys_page, site_keys_page
from tools.metric_page import metric_page
from tools.quality_page import quality_page

__all__ = ["PAGES", "main"]

PAGES: Mapping[str, Callable[[], str]] = {
    "cli.md": command_page,
    "site-file-keys.md": site_keys_page,
    "scenario-file-keys.md": scenario_keys_page,
    "block-registers.md": block_page,
    "metrics.md": metric_page,
    "quality-codes.md": quality_page,
}
"""By file name, what writes the page."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write all pages."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/reference"), help="folder")
    folder: Path = parser.parse_args(arguments).out
    folder.mkdir(parents=True, exist_ok=True)
    for name, page in PAGES.items():
        (folder / name).write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
