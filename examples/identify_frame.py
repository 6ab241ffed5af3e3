"""Identify a loop from a data frame: verdict, S and J, and the stem, which was not measured.

    python examples/identify_frame.py [FILE.csv]

The file needs columns op and pv; the one that ships with the sites is read otherwise.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from estimator import identify

SHIPPED = Path(__file__).resolve().parents[1] / "site_configs" / "FC202.csv"


def main(file: Path) -> pd.DataFrame:
    """Print the verdict; return the frame with the estimated stem beside OP."""
    loop = pd.read_csv(file)
    period = float(loop["time"].diff().median()) if "time" in loop else 1.0
    found = identify(loop["op"], loop["pv"], sp=loop.get("sp"), period=period)

    print(f"{file.name}: {found.verdict.value}, score {found.score:.0f}")
    print(f"  stick band S {found.stick_band.value:.2f}", end="")
    print(f" [{found.stick_band.low:.2f}, {found.stick_band.high:.2f}]")
    for reason in found.reasons:
        print(f"  {reason.text}. {reason.advice}")
    return loop.assign(stem=found.stem, pv_model=found.pv_model)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED)
