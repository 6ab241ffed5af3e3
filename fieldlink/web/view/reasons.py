"""Why a verdict is what it is, and what would make it surer: sentences with their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fieldlink.site import Loop
from fieldlink.web.view.store_queries import Row
from fieldlink.web.view.texts import duration_text, number_text, percent_text

__all__ = ["what_to_do", "what_would_help", "why"]

FEW_REVERSALS = 10
"""Turns of the stem below which more of them narrow the intervals most."""

POORLY_INFORMED = 0.5
"""Share of PV's movements that are measured and not drawn between two values."""

SLOW_POLLING = 10.0
"""Samples of one swing below which its shape is hard to see."""

WIDE = 0.25
"""Half width of an interval over its value from which a longer window is worth its time."""


def why(judged: Row | None, last: Row | None, *, compensated: bool) -> list[str]:
    """Return the reasons of the newest verdict as sentences.

    Args:
        judged: the newest estimate with a verdict.
        last: the newest estimate of all.
        compensated: whether the PLC's controller uses a model of this valve.
    """
    said: list[str] = []
    if compensated and judged is not None and last is not None and last["id"] != judged["id"]:
        said.append(
            "The PLC's compensator uses the model, so the newest windows cannot show the valve. "
            "The verdict is that of the window from which the model comes."
        )
    if last is not None and last["verdict"] is None:
        said.append(f"The newest window gave no result: {last['message'].strip(' ;')}.")
    if judged is None:
        return said or ["No window has been judged yet."]
    document: Mapping[str, Any] = judged["document"] or {}
    reasons = [_sentence(text) for text in document.get("reasons", [])]
    said += reasons
    fit, evidence = document.get("fit") or {}, document.get("evidence") or {}
    has_figures = any("log Bayes factor" in reason for reason in reasons)
    if not has_figures and fit.get("r2") is not None and fit.get("r2_healthy_valve") is not None:
        said.append(
            f"With the identified valve the model explains {percent_text(fit['r2'])} of PV's "
            f"variance, with a healthy one {percent_text(fit['r2_healthy_valve'])}."
        )
    factor = evidence.get("log_bayes_factor")
    if not has_figures and factor is not None:
        likelier, other = ("sticky", "healthy") if factor > 0.0 else ("healthy", "sticky")
        said.append(
            f"The window is {_times(abs(factor))} likelier with a {likelier} valve than with a "
            f"{other} one (log Bayes factor {number_text(factor, 3)})."
        )
    if judged["verdict"] == "stiction" and evidence.get("reversals") is not None:
        said.append(
            f"The stem turned {evidence['reversals']} times in {document.get('samples', 0)} "
            f"samples and moved in {evidence.get('moves', 0)} of them."
        )
    said += [_sentence(text) for text in document.get("identifiability", [])]
    return list(dict.fromkeys(said))


def what_to_do(judged: Row | None) -> list[str]:
    """Return the estimator's advice: the repair of a sticky valve, else how to find out more."""
    document: Mapping[str, Any] = {} if judged is None else judged["document"] or {}
    return [_sentence(text) for text in document.get("advice", [])]


def what_would_help(
    row: Mapping[str, Any], judged: Row | None, settings: Loop | None, fault: str = ""
) -> list[str]:
    """Return what would make the verdict surer, the most useful first.

    Args:
        row: the loop in the fleet.
        judged: the newest estimate with a verdict.
        settings: of the loop; None without a site file.
        fault: why the newest sample is bad; empty when it is not.
    """
    bad = [f"Good values, where the newest are bad. {fault}."] if fault else []
    if judged is None and bad:
        return bad
    if judged is None:
        missing = row.get("filled")
        if missing is not None and missing < 1.0:
            return [f"Wait: the window is {percent_text(missing)} full."]
        if missing is not None and not row.get("message"):
            return [
                "Wait: the window is full and being judged; the first time after an installation "
                "that takes minutes."
            ]
        return ["Wait for a full window; fieldlink status shows how much of it is there."]
    document: Mapping[str, Any] = judged["document"] or {}
    evidence, window = document.get("evidence") or {}, document.get("window") or {}
    said = bad + ([] if judged["verdict"] == "stiction" else what_to_do(judged))
    manual = "not_in_automatic" in document.get("reason_codes", [])
    if manual and settings is not None and settings.mode is not None:
        values = ", ".join(f"{value:g}" for value in settings.auto_values)
        said.append(
            f"If it is in automatic: other auto_values in the site file ({values} now), such as "
            f"{settings.mode} shows."
        )
    if not manual and judged["verdict"] != "no_stiction" and evidence.get("reversals") is not None:
        turns = evidence["reversals"]
        if turns < FEW_REVERSALS:
            said.append(
                f"A set-point step of a few stick bands, or a longer window: the stem turned only "
                f"{turns} times in this one."
            )
    informed = evidence.get("informed")
    if informed is not None and informed < POORLY_INFORMED:
        said.append(
            f"An uncompressed PV: only {percent_text(informed)} of its movements are measured, the "
            "rest is drawn between two values."
        )
    swing, period = window.get("swing_period_s"), document.get("period_s")
    if swing and period and swing / period < SLOW_POLLING:
        said.append(
            f"Faster polling: one swing of {duration_text(swing)} has only "
            f"{number_text(swing / period, 2)} samples."
        )
    if judged["verdict"] == "stiction":
        longer = "" if settings is None else f" than {settings.window} samples"
        for name, symbol in (("stick_band", "S"), ("slip_jump", "J")):
            half = _half_width(row[name])
            if half is not None and half > WIDE:
                said.append(
                    f"A longer window{longer}, or set-point steps of different sizes: the interval "
                    f"of {symbol} is {percent_text(2.0 * half)} of its value wide."
                )
    if (window.get("automatic") or 1.0) < 1.0:
        said.append(
            f"A window wholly in automatic: the loop was in manual for "
            f"{percent_text(1.0 - window['automatic'])} of this one."
        )
    if (window.get("good") or 1.0) < 0.95:
        said.append(f"Fewer gaps: {percent_text(1.0 - window['good'])} of the samples are missing.")
    return list(dict.fromkeys(said)) or ["Nothing more is needed; the next windows confirm it."]


def _half_width(interval: Mapping[str, float | None]) -> float | None:
    value, low, high = interval["value"], interval["low"], interval["high"]
    if not value or low is None or high is None:
        return None
    return 0.5 * (high - low) / value


def _times(nats: float) -> str:
    if nats > 14.0:
        return "more than a million times"
    return f"{number_text(2.718281828**nats, 2)} times"


def _sentence(text: str) -> str:
    text = text.strip()
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "?", "!")) else f"{text}."
