"""Verdicts on recorded loops beside their published labels: ``python -m benchmarks.industrial``.

Reads the labelled loops beside the repository (``../shared/data`` or ``--data``): the plant's
windows with the confidence of the plant's own monitoring tool, and loops of the International
Stiction Data Base.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import machine, table
from estimator import Identification, Verdict, identify, warm_up

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"


def read_loop(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """OP and PV of a recorded loop, shape ``(n,)`` each."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return (
        np.array([float(row["op"] or "nan") for row in rows]),
        np.array([float(row["pv"] or "nan") for row in rows]),
    )


def roc_auc(scores: np.ndarray, sticky: np.ndarray) -> float:
    """Area under the ROC curve: how often a sticky loop scores above a healthy one."""
    ahead = scores[sticky][:, None] - scores[~sticky]
    if ahead.size == 0:
        return float("nan")
    return float((ahead > 0).mean() + 0.5 * (ahead == 0).mean())


def _row(label: dict[str, str], result: Identification) -> dict[str, Any]:
    return {
        "file": label["file"],
        "type": label["loop_type"],
        "loop": label.get("loop", label["file"]),
        "label": label["label"],
        "published_index": float(label["published_index"]) if "published_index" in label else None,
        **{
            key: value
            for key, value in result.to_dict().items()
            if key in ("verdict", "score", "stick_band", "slip_jump", "fit", "criterion", "seconds")
        },
        "reasons": [reason.code.value for reason in result.reasons],
    }


def _judge(folder: Path, labels: Path, period: float) -> list[dict[str, Any]]:
    with labels.open(newline="") as file:
        listed = list(csv.DictReader(file))
    return [
        _row(label, identify(*read_loop(folder / label["file"]), period=period)) for label in listed
    ]


def _print(title: str, rows: list[dict[str, Any]]) -> None:
    header = ("file", "label", "verdict", "score", "S", "S low", "S high", "J", "fit", "healthy")
    lines = [
        (
            row["file"],
            row["label"],
            row["verdict"]
            if row["verdict"] != Verdict.NOT_ASSESSABLE
            else f"not assessable: {', '.join(row['reasons'])}",
            row["score"],
            *(_float(row["stick_band"][key]) for key in ("value", "low", "high")),
            _float(row["slip_jump"]["value"]),
            _float(row["fit"]["r2"]),
            _float(row["fit"]["r2_healthy_valve"]),
        )
        for row in rows
    ]
    print(f"\n## {title}\n\n{table(header, lines)}")


def _float(value: float | None) -> float:
    return float("nan") if value is None else value


def _summary(plant: list[dict[str, Any]], isdb: list[dict[str, Any]]) -> dict[str, Any]:
    judged = [row for row in plant if row["verdict"] != Verdict.NOT_ASSESSABLE]
    sticky = np.array([row["label"] == "stiction" for row in judged])
    return {
        "plant_windows": len(plant),
        "plant_not_assessable": len(plant) - len(judged),
        "plant_verdicts_right": sum(row["verdict"] == row["label"] for row in judged),
        "plant_auc": roc_auc(np.array([row["score"] for row in judged]), sticky),
        "plant_auc_published_index": roc_auc(
            np.array([row["published_index"] for row in judged]), sticky
        ),
        "isdb_loops": len(isdb),
        "isdb_verdicts_right": sum(row["verdict"] == row["label"] for row in isdb),
        "seconds_median": float(np.median([row["seconds"] for row in (*judged, *isdb)])),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the recorded loops")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    if not options.data.is_dir():
        print(f"no recorded loops at {options.data}: give --data FOLDER", file=sys.stderr)
        return 2
    warm_up()
    plant = _judge(options.data / "plant", options.data / "plant_labels.csv", 10.0)
    isdb = _judge(options.data / "isdb", options.data / "isdb_labels.csv", 1.0)
    summary = _summary(plant, isdb)
    _print("Plant", plant)
    _print("International Stiction Data Base", isdb)
    print(f"\n{table(('figure', 'value'), list(summary.items()))}")
    if options.json is not None:
        figures = {"machine": machine(), "summary": summary, "plant": plant, "isdb": isdb}
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
