"""Speeds of the plants in this checkout and in another one, in turn. For `benchmarks.fmu`."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

__all__ = ["measure_in_turn"]

_IN_A_CHECKOUT = "import json, benchmarks.fmu as b; print(json.dumps(b._lockstep()))"


def measure_in_turn(other: Path, instead: str, turns: int = 3) -> list[list[Any]]:
    """Measure this checkout and another in turn, so that the machine's load is that of both.

    Args:
        other: folder of the other checkout.
        instead: the row of the other checkout for rows that it does not have.
        turns: of each; the best counts.

    Returns:
        A row for each plant: name, samples a second here and there, and their ratio.
    """
    here = Path(__file__).resolve().parent.parent
    best: dict[Path, dict[str, float]] = {here: {}, other: {}}
    for _ in range(turns):
        for checkout, found in best.items():
            done = subprocess.run(
                [sys.executable, "-c", _IN_A_CHECKOUT],
                cwd=checkout,
                capture_output=True,
                text=True,
                check=True,
            )
            for name, isolated, *_ in json.loads(done.stdout.splitlines()[-1]):
                found[name] = max(found.get(name, 0.0), isolated)
    rows = []
    for name, rate in best[here].items():
        before = best[other].get(name, best[other].get(instead, math.nan))
        rows.append([name, f"{rate:,.0f}", f"{before:,.0f}", f"{rate / before:.1f}"])
    return rows
