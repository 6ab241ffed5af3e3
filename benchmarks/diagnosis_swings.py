"""How often signals with and without an oscillation are told from each other, kind by kind.

``python -m benchmarks.diagnosis_swings --beside 0 0.4 0.6 1`` compares widths of the bands that
tell how much of an oscillation's own band is drift. The signals are of the tuning family: they
choose what counts as an oscillation, and no figure of theirs is reported.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

from benchmarks.diagnosis_families.tuning.swings import RESTING, SWINGING, draw_signal
from benchmarks.report import table
from estimator.diagnosis.settings import DIAGNOSIS
from fieldlink.diagnosis import detect_oscillation


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--signals", type=int, default=400, help="signals of every kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    default = DIAGNOSIS.swinging.beside
    parser.add_argument("--beside", type=float, nargs="+", default=[default], help="octaves")
    options = parser.parse_args(arguments)
    rows = []
    for kind in (*SWINGING, *RESTING):
        row: list[object] = [kind, "yes" if kind in SWINGING else "no"]
        for beside in options.beside:
            settings = replace(DIAGNOSIS.swinging, beside=beside)
            called, near = 0, 0
            for seed in range(options.first, options.first + options.signals):
                values, period = draw_signal(kind, seed)
                found = detect_oscillation(values, settings=settings)
                called += found.present
                near += found.present and abs(found.period_s / period - 1.0) < 0.1
            row += [called, near if kind in SWINGING else ""]
        rows.append(row)
    heads = [head for one in options.beside for head in (f"called, {one:g}", "period in 10 %")]
    print(table(["signal", "oscillates", *heads], rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
