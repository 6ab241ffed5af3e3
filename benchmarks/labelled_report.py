"""Verdicts beside labels: tables, what a release is judged by, and thresholds without each loop."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.companions import companions
from benchmarks.recorded import Judged
from benchmarks.report import table
from benchmarks.roc import LeftOut, Roc, auc, best_threshold, leave_one_loop_out, roc

__all__ = ["LabelledReport", "labelled_report"]


@dataclass(frozen=True, slots=True)
class LabelledReport:
    """Markdown, the same as plain types, and the ROC curves of the plant's windows by name."""

    text: str
    figures: dict[str, Any]
    curves: dict[str, Roc]


def _verdicts(title: str, judged: Sequence[Judged]) -> str:
    header = (
        "file", "label", "verdict", "score", "simulated", "whitened", "S", "S 90 %", "J", "J 90 %",
        "fit", "healthy fit", "index",
    )  # fmt: skip
    rows = []
    for one in judged:
        r = one.result
        verdict = r.verdict.value if one.is_right else f"**{r.verdict.value}**"
        if not one.is_assessable:
            verdict = "not assessable: " + ", ".join(x.code.value for x in r.reasons)
        rows.append(
            (
                *(one.window.file, one.window.label, verdict, r.score),
                *(r.evidence.simulated, r.evidence.whitened),
                *(r.stick_band.value, _range(r.stick_band)),
                *(r.slip_jump.value, _range(r.slip_jump)),
                *(r.fit.r2, r.fit.r2_healthy_valve),
                "" if one.window.index is None else one.window.index,
            )
        )
    return f"## {title}\n\n{table(header, rows)}"


def _range(interval: Any) -> str:
    low, high = interval.low, interval.high
    return "" if np.isnan(low) else f"{low:.3g} to {high:.3g}"


def _unassessable(judged: Sequence[Judged]) -> str:
    lines = [
        f"- {one.window.file} ({one.window.label}): "
        + " ".join(f"{reason.text}. {reason.advice}" for reason in one.result.reasons)
        for one in judged
        if not one.is_assessable
    ]
    return "## Not assessable\n\n" + ("\n".join(lines) or "none")


def _score(one: Judged) -> float:
    return one.result.score


def _simulated(one: Judged) -> float:
    return one.result.evidence.simulated


def _whitened(one: Judged) -> float:
    return one.result.evidence.whitened


def _index(one: Judged) -> float:
    """In percent; a window without one cannot be compared."""
    if one.window.index is None:
        raise ValueError(f"{one.window.file} has no published index")
    return 100.0 * one.window.index


_FIGURES: dict[str, Callable[[Judged], float]] = {
    "score": _score,
    "simulated": _simulated,
    "whitened": _whitened,
    "published index, %": _index,
}
"""What a threshold can be put on."""


def _left_out(judged: Sequence[Judged], figure: Callable[[Judged], float]) -> tuple[LeftOut, ...]:
    return leave_one_loop_out(
        [figure(one) for one in judged],
        [one.is_sticky for one in judged],
        [one.window.loop for one in judged],
    )


def _thresholds(plant: Sequence[Judged], isdb: Sequence[Judged]) -> tuple[str, dict[str, Any]]:
    """Every loop judged by a threshold that its windows had no part in."""
    both = [*plant, *isdb]
    score = _left_out(both, _score)
    chosen = best_threshold(
        [one.result.score for one in both],
        [one.is_sticky for one in both],
        [one.window.loop for one in both],
    )
    header = ("left-out loop", "label", "windows", "threshold on the score", "right")
    rows = [
        (o.loop, "stiction" if o.sticky else "no_stiction", o.windows, o.threshold, o.right)
        for o in score
    ]
    compared = []
    for name, figure in _FIGURES.items():
        judged = plant if figure is _index else both
        out = _left_out(judged, figure)
        right, windows = sum(o.right for o in out), sum(o.windows for o in out)
        whole = sum(o.right == o.windows for o in out)
        limits = [o.threshold for o in out]
        compared.append(
            (
                name,
                f"{min(limits):.3g} to {max(limits):.3g}",
                f"{right} of {windows}",
                f"{whole} of {len(out)}",
            )
        )
    plain = ("threshold on", "chosen by the others", "windows right", "loops wholly right")
    text = (
        "## Thresholds, each loop left out in turn\n\n"
        f"All loops together choose {chosen:.3g} for the score.\n\n"
        f"{table(header, rows)}\n\n{table(plain, compared)}"
    )
    return text, {
        "score_threshold": chosen,
        "left_out": [asdict(one) for one in score],
        "compared": [dict(zip(plain, row, strict=True)) for row in compared],
    }


def _summary(plant: Sequence[Judged], isdb: Sequence[Judged]) -> dict[str, Any]:
    able = [one for one in plant if one.is_assessable]
    sticky = [one.is_sticky for one in able]
    rest = [one for one in plant if not one.is_assessable]
    why = Counter(reason.code.value for one in rest for reason in one.result.reasons)
    every = [one.result.seconds for one in (*plant, *isdb) if one.is_assessable]
    return {
        "plant windows": len(plant),
        "plant, not assessable": len(plant) - len(able),
        "plant, not assessable %": 100.0 * (1.0 - len(able) / len(plant)),
        "reasons": ", ".join(f"{name} {count}" for name, count in sorted(why.items())),
        "plant, verdicts right of assessable": sum(one.is_right for one in able),
        "AUC of score, assessable plant windows": auc(list(map(_score, able)), sticky),
        "AUC of published index, same windows": auc(list(map(_index, able)), sticky),
        "ISDB loops": len(isdb),
        "ISDB verdicts right": sum(one.is_right for one in isdb),
        "median seconds": float(np.median(every)),
    }


def labelled_report(plant: Sequence[Judged], isdb: Sequence[Judged]) -> LabelledReport:
    """All of it for the plant's windows and the loops of the data base."""
    able = [one for one in plant if one.is_assessable]
    sticky = [one.is_sticky for one in able]
    summary = _summary(plant, isdb)
    able_isdb = [one for one in isdb if one.is_assessable]
    thresholds, chosen = _thresholds(able, able_isdb)
    beside, indices = companions(able, able_isdb)
    text = "\n\n".join(
        (
            table(("figure", "value"), list(summary.items())),
            _verdicts("Plant", plant),
            _verdicts("International Stiction Data Base", isdb),
            _unassessable([*plant, *isdb]),
            thresholds,
            beside,
        )
    )
    return LabelledReport(
        text=text,
        figures={
            "summary": summary,
            "plant": [one.to_dict() for one in plant],
            "isdb": [one.to_dict() for one in isdb],
            "thresholds": chosen,
            **indices,
        },
        curves={
            "score": roc(list(map(_score, able)), sticky),
            "published index": roc(list(map(_index, able)), sticky),
        },
    )
