"""The picture of a report in the documentation: page one and the first page of evidence.

    python -m benchmarks.report_picture --images docs/images

A made-up fleet of twelve loops (`benchmarks.made_fleet`), two of them with an owner; the page as
Chromium shows it (Debian's package ``chromium``).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.made_fleet import END_MS, Fleet, make_fleet
from fieldlink.store import record_work

SIZE = (1500, 1750)
"""Pixels: the list of twelve loops and one page of evidence."""


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.report_picture")
    parser.add_argument("--images", type=Path, required=True)
    parser.add_argument("--chromium", default="chromium")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        fleet = Fleet(Path(folder) / "mill.sqlite", loops=12, days=200)
        make_fleet(fleet)
        record_work(fleet.url, "FC111", "planned", owner="Meyer", note="packing, next stop",
                    utc_ms=END_MS)  # fmt: skip
        record_work(fleet.url, "FC103", "verified", owner="Li", note="packing replaced",
                    utc_ms=END_MS - 40 * 86_400_000)  # fmt: skip
        page = Path(folder) / "report.html"
        report = [sys.executable, "-m", "fieldlink.cli", "report", str(fleet.file)]
        subprocess.run([*report, "--out", str(page)], check=True, stdout=subprocess.DEVNULL)
        picture = given.images.absolute() / "report.png"
        subprocess.run(
            [
                given.chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                f"--screenshot={picture}", f"--window-size={SIZE[0]},{SIZE[1]}", page.as_uri(),
            ],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
    print(picture)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
