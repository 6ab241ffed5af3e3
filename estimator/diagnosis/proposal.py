"""Better settings for a diagnosed loop, where proposing some makes sense."""

from __future__ import annotations

import math

import numpy as np

from estimator.controller.controller import Controller
from estimator.diagnosis.explanations import Explained
from estimator.diagnosis.facts import Limits
from estimator.diagnosis.loop_record import LoopRecord
from estimator.diagnosis.plausible import find_plausible
from estimator.diagnosis.result import Cause, CauseName
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.tuning import Advice, RecordedLoop, advise
from loop_model import ValveModel

__all__ = ["propose"]


def propose(
    cut: LoopRecord,
    explained: Explained,
    controller: Controller,
    limits: Limits,
    causes: tuple[Cause, ...],
    settings: DiagnosisSettings,
    *,
    has_gap: bool = False,
) -> Advice | None:
    """Return settings and what they would do to the record ``cut``; None where none make sense.

    ``has_gap``: whether the controller leaves small errors as they are.
    """
    # not one linear process, PV is not the process's own, or it is not known what moves it
    names, first = [cause.name for cause in causes], causes[0].name
    if CauseName.CHARACTERISTIC in names or CauseName.SENSOR in names:
        return None
    if first is CauseName.UNDETERMINED or explained.over_waves < settings.judging.threshold:
        return None
    # a tuning that swings drives OP to its limits; else they are what the load asks for
    if CauseName.SATURATION in names and first is not CauseName.TIGHT_TUNING:
        return None
    if explained.fitted is None:
        return None
    if has_gap:
        # what is simulated has none
        return None
    assert cut.pv is not None
    assert cut.error is not None
    sp = cut.sp if cut.sp is not None else np.full(cut.op.size, np.median(cut.pv + cut.error))
    valve = ValveModel(explained.band, min(explained.jump, explained.band))
    ends = (
        float(cut.op.min()) if limits.low else -math.inf,
        float(cut.op.max()) if limits.high else math.inf,
    )
    return advise(
        find_plausible(explained.fitted, settings.advising),
        controller,
        RecordedLoop.of(cut.pv, sp, explained.stem, ends, valve, slides=explained.slides),
        settings.advising,
    )
