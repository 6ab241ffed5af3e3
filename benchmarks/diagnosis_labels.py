"""Recorded loops that people have labelled oscillating or not, beside what the program finds."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from benchmarks.report import table
from fieldlink.diagnosis import detect_oscillation

ARGUED = {
    "CHEM20": "five slow waves, 85 to 200 samples apart, then rest: no period",
    "CHEM33": "OP changes between two levels after 3 to 40 samples: it swings, without a period",
    "CHEM37": "seven slow swings, 140 to 350 samples apart: no period",
    "CHEM60": "swings of 17 samples, uneven in height, among slower ones as large, which are taken "
    "for a drift: their share is just below 0.5. A miss",
}
"""What a look at the record shows, where label and program did not agree."""


def recorded(data: Path) -> str:
    """The labelled recordings: how many labels agree, and those that do not."""
    labels = data / "oscillation_labels.csv"
    if not labels.is_file():
        return f"Skipped: {labels.name} is absent."
    rows, argued, agree, count = [], [], 0, 0
    with labels.open() as stream:
        for row in csv.DictReader(stream):
            op = np.genfromtxt(data / "oscillation" / row["file"], skip_header=1)
            found = detect_oscillation(op, period=float(row["period_s"]))
            same = found.present == (row["oscillating"] == "1")
            count, agree = count + 1, agree + same
            if same:
                continue
            rows.append([row["file"], row["oscillating"], int(found.present), found.period_s,
                         found.regularity, found.cycles, found.share])  # fmt: skip
            name = Path(row["file"]).stem
            if name in ARGUED:
                argued.append(f"- {name}: {ARGUED[name]}.")
    head = ["file", "label", "found", "period / s", "regularity", "periods", "share"]
    found_others = f"{agree} of {count} labels agree. The others:\n\n{table(head, rows)}"
    return "\n\n".join([found_others, "\n".join(argued)]) if argued else found_others
