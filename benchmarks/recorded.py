"""The recorded and labelled loops beside the repository, and what the estimator says of each.

``../shared/data`` (or ``--data``) holds ``plant/`` with ``plant_labels.csv``, windows of refinery
loops with the index of the plant's own monitoring tool, and ``isdb/`` with ``isdb_labels.csv``.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator import Identification, identify

__all__ = ["DATA", "Judged", "Labelled", "judged", "labelled_loops", "read_columns"]

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"
"""Where the recorded loops stand, if they do."""


@dataclass(frozen=True, slots=True)
class Labelled:
    """A window with its published label.

    Attributes:
        file: its name. loop: all windows of one loop share it. kind: flow, level, ...
        label: ``"stiction"`` or ``"no_stiction"``.
        index: confidence of the plant's own tool, None where there is none.
        period_s: seconds between samples, 1 where the file has no time.
        begun: seconds since 1970 of its first sample, None where the file has no time.
        op, pv: samples, shape ``(n,)``, NaN where bad. sp, auto: likewise, or None.
    """

    file: str
    loop: str
    kind: str
    label: str
    index: float | None
    period_s: float
    begun: float | None
    op: Array
    pv: Array
    sp: Array | None
    auto: Array | None


@dataclass(frozen=True, slots=True)
class Judged:
    """A labelled window and the estimator's result."""

    window: Labelled
    result: Identification

    @property
    def is_assessable(self) -> bool:
        """Whether there is a verdict on the valve."""
        return self.result.verdict.value != "not_assessable"

    @property
    def is_sticky(self) -> bool:
        """By its label."""
        return self.window.label == "stiction"

    @property
    def is_right(self) -> bool:
        """Whether the verdict is the label."""
        return self.result.verdict.value == self.window.label

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        w, r = self.window, self.result
        chosen = ("verdict", "score", "stick_band", "slip_jump", "fit", "criterion", "seconds")
        answer = r.to_dict()
        return {
            "file": w.file,
            "loop": w.loop,
            "type": w.kind,
            "label": w.label,
            "published_index": w.index,
            **{key: answer[key] for key in chosen},
            "process": r.process.structure,
            "evidence": asdict(r.evidence),
            "reasons": [reason.code.value for reason in r.reasons],
            "reason_texts": [reason.text for reason in r.reasons],
        }


def read_columns(path: Path) -> dict[str, list[str]]:
    """Columns of a CSV file by name."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def _numbers(cells: list[str]) -> Array:
    return np.array([float(cell or "nan") for cell in cells])


def _clock(cells: list[str]) -> Array:
    """Seconds since 1970 of a time column in UTC."""
    return np.array([datetime.fromisoformat(cell + "+00:00").timestamp() for cell in cells])


def labelled_loops(data: Path, collection: str) -> tuple[Labelled, ...]:
    """Every labelled window of ``"plant"`` or ``"isdb"`` below ``data``."""
    with (data / f"{collection}_labels.csv").open(newline="") as file:
        labels = list(csv.DictReader(file))
    found = []
    for label in labels:
        columns = read_columns(data / collection / label["file"])
        signals = {k: _numbers(columns[k]) for k in ("op", "pv", "sp", "auto") if k in columns}
        index = label.get("published_index")
        clock = _clock(columns["time"]) if "time" in columns else None
        # The clock knows better than the table of labels: one window has a sample a minute.
        period = 1.0 if clock is None else float(np.median(np.diff(clock)))
        found.append(
            Labelled(
                file=label["file"],
                loop=label.get("loop", label["file"].removesuffix(".csv")),
                kind=label["loop_type"],
                label=label["label"],
                index=None if index is None else float(index),
                period_s=period,
                begun=None if clock is None else float(clock[0]),
                op=signals["op"],
                pv=signals["pv"],
                sp=signals.get("sp"),
                auto=signals.get("auto"),
            )
        )
    return tuple(found)


def judged(
    windows: Sequence[Labelled], identification: Callable[..., Identification] = identify
) -> list[Judged]:
    """Every window with its result, in order."""
    return [
        Judged(
            w,
            identification(w.op, w.pv, sp=w.sp, auto=w.auto, period=w.period_s),
        )
        for w in windows
    ]
