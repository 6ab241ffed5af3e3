"""What is wrong with a loop and what to do about it: causes, each with evidence and an action.

    finding_of_estimate(identification.to_dict())     # the estimator's verdict and reasons
    finding_of_diagnosis(document["causes"])          # causes of a diagnosis, which say more

A finding without a cause that can be acted on is undetermined, and says what would determine it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from estimator import ReasonCode

__all__ = ["Action", "Cause", "Finding", "Wrong", "finding_of_diagnosis", "finding_of_estimate"]


class Action(Enum):
    """The next step.

    Attributes:
        code: for programs.
        brief: for a cell.
        text: for a page.
        needs_outage: whether the loop has to be out of service for it.
    """

    REPAIR_VALVE = (
        "repair_valve",
        "check packing, positioner, air supply",
        "check the packing, the positioner and the air supply: air and positioner in service, the "
        "packing at the next stop",
        True,
    )
    CHECK_SIZING = (
        "check_sizing",
        "check range and valve size",
        "check the range of OP, the valve's size and the operating point",
        False,
    )
    RETUNE = ("retune", "retune", "retune the controller", False)
    FIND_DISTURBANCE = (
        "find_disturbance",
        "find the disturbance",
        "find the disturbance that enters from outside the loop",
        False,
    )
    LINEARISE = (
        "linearise",
        "compensate the characteristic",
        "compensate the characteristic in the controller or the positioner, or schedule the gain",
        False,
    )
    CHECK_TRANSMITTER = (
        "check_transmitter",
        "check the transmitter",
        "check the transmitter and the recording of PV",
        False,
    )
    PUT_IN_AUTOMATIC = (
        "put_in_automatic",
        "put in automatic",
        "find out why the loop is in manual; put it in automatic",
        False,
    )
    MEASURE_AGAIN = (
        "measure_again",
        "measure again",
        "record what would determine the cause",
        False,
    )
    CORRECT_RECORDING = (
        "correct_recording",
        "correct the recording",
        "correct the recording or export it again, as its reason says",
        False,
    )
    NOTHING = ("nothing", "nothing", "nothing to do", False)

    def __init__(self, code: str, brief: str, text: str, needs_outage: bool) -> None:
        self.code = code
        self.brief = brief
        self.text = text
        self.needs_outage = needs_outage


class Wrong(Enum):
    """What is wrong, in the names of a diagnosis; the text is for a meeting."""

    STICKY_VALVE = ("sticky_valve", "valve sticks", Action.REPAIR_VALVE)
    EXTERNAL_OSCILLATION = (
        "external_oscillation",
        "oscillation from outside the loop",
        Action.FIND_DISTURBANCE,
    )
    TIGHT_TUNING = ("tight_tuning", "controller tuned too tight", Action.RETUNE)
    SLOW_TUNING = ("slow_tuning", "controller tuned too slow", Action.RETUNE)
    SATURATION = ("saturation", "OP at its limit", Action.CHECK_SIZING)
    CHARACTERISTIC = (
        "characteristic",
        "gain changes with the operating point",
        Action.LINEARISE,
    )
    SENSOR = ("sensor", "PV is not measured well", Action.CHECK_TRANSMITTER)
    MANUAL = ("manual", "loop in manual", Action.PUT_IN_AUTOMATIC)
    QUIET = ("quiet", "nothing found", Action.NOTHING)
    UNDETERMINED = ("undetermined", "undetermined", Action.MEASURE_AGAIN)
    UNREADABLE = ("unreadable", "recording cannot be used", Action.CORRECT_RECORDING)

    def __init__(self, code: str, text: str, action: Action) -> None:
        self.code = code
        self.text = text
        self.action = action

    @classmethod
    def of(cls, code: str) -> Wrong:
        """Return the member of a code; a code of a later release is undetermined."""
        return next((member for member in cls if member.code == code), cls.UNDETERMINED)


@dataclass(frozen=True, slots=True)
class Cause:
    """One explanation.

    Attributes:
        wrong: which.
        evidence: sentences with figures.
        weight: 0 to 1, how much of the trouble it explains; None where nothing weighs it.
        advice: the next step in words of this loop; the action's own text unless given.
    """

    wrong: Wrong
    evidence: tuple[str, ...] = ()
    weight: float | None = None
    advice: str = ""

    @property
    def action(self) -> Action:
        """The next step."""
        return self.wrong.action


@dataclass(frozen=True, slots=True)
class Finding:
    """The causes of a loop, the heaviest first, and what would determine what is not known.

    Attributes:
        causes: at least one.
        would_determine: sentences; empty where nothing is open.
        is_sure: whether the evidence is clear of its threshold.
    """

    causes: tuple[Cause, ...]
    would_determine: tuple[str, ...] = ()
    is_sure: bool = True

    @property
    def main(self) -> Cause:
        """The heaviest cause."""
        return self.causes[0]

    @property
    def wrong(self) -> Wrong:
        """What is wrong above all."""
        return self.main.wrong

    @property
    def action(self) -> Action:
        """The next step."""
        return self.main.action

    @property
    def action_text(self) -> str:
        """The next step in words."""
        return self.main.advice or self.action.text

    @property
    def others(self) -> tuple[Wrong, ...]:
        """What else is wrong."""
        return tuple(cause.wrong for cause in self.causes[1:])


_CAUSE_OF_REASON = {
    ReasonCode.STICKY_VALVE_EXPLAINS: Wrong.STICKY_VALVE,
    ReasonCode.HEALTHY_VALVE_SUFFICES: Wrong.QUIET,
    ReasonCode.BAND_TOO_SMALL: Wrong.QUIET,
    ReasonCode.DISTURBANCE_EXPLAINS: Wrong.EXTERNAL_OSCILLATION,
    ReasonCode.NOT_IN_AUTOMATIC: Wrong.MANUAL,
    ReasonCode.OP_AT_LIMIT: Wrong.SATURATION,
    ReasonCode.PV_FROZEN: Wrong.SENSOR,
    ReasonCode.PV_FAULTS: Wrong.SENSOR,
    ReasonCode.PV_AT_LIMIT: Wrong.SENSOR,
}
"""What the estimator's reasons mean for a work list; every other reason leaves the cause open."""

_OF_VERDICT = {"stiction": Wrong.STICKY_VALVE, "no_stiction": Wrong.QUIET}

OUTSIDE_OR_TUNING = (
    "put the controller in manual for a few periods: an oscillation that goes on comes from "
    "outside the loop, one that ends from its tuning; fieldlink diagnose compares the causes"
)


def finding_of_estimate(
    document: Mapping[str, Any], *, oscillates: bool = False, period_s: float | None = None
) -> Finding:
    """Return what the estimator's result means for a work list.

    Args:
        document: `estimator.Identification.to_dict`.
        oscillates: whether PV oscillates regularly in the window.
        period_s: of that oscillation, seconds.
    """
    verdict = str(document.get("verdict"))
    uncertain = bool(document.get("uncertain", False))
    reasons = tuple(str(text) for text in document.get("reasons", ()))
    advice = tuple(str(text) for text in document.get("advice", ()))
    limits = tuple(str(text) for text in document.get("identifiability", ()))
    if uncertain:
        over_wave = document.get("evidence", {}).get("over_waves")
        likely = "probably sticks" if verdict == "stiction" else "is probably healthy"
        if verdict == "stiction" and over_wave is not None and over_wave < 0.0:
            # a wave from outside is the likelier of the two
            likely = "may stick"
        evidence = (f"the valve {likely}, but the other answer is possible", *reasons)
        return Finding((Cause(Wrong.UNDETERMINED, evidence),), _unique(advice), is_sure=False)
    codes = [code for code in ReasonCode if code.value in document.get("reason_codes", ())]
    known = [_CAUSE_OF_REASON[code] for code in codes if code in _CAUSE_OF_REASON]
    wrong = _OF_VERDICT.get(verdict, Wrong.UNDETERMINED)
    if verdict != "stiction" and known:
        wrong = known[0]
    if wrong is Wrong.QUIET and oscillates:
        swing = f"PV oscillates with a period of {period_s:.3g} s" if period_s else "PV oscillates"
        evidence = (f"{swing}, and a healthy valve explains the window", *reasons)
        return Finding((Cause(Wrong.UNDETERMINED, evidence),), (OUTSIDE_OR_TUNING,))
    if wrong is Wrong.UNDETERMINED:
        return Finding((Cause(wrong, reasons),), _unique(advice), is_sure=False)
    return Finding((Cause(wrong, (*reasons, *limits)),))


def finding_of_diagnosis(
    causes: Sequence[Mapping[str, Any]], would_determine: Sequence[str] = ()
) -> Finding:
    """Return the finding of a diagnosis' causes, heaviest first.

    Args:
        causes: each with ``name``, ``weight``, ``evidence`` (sentences) and ``action`` (a
            sentence).
        would_determine: what would settle what is open; the advice of an undetermined cause unless
            given.
    """
    found = tuple(
        Cause(
            Wrong.of(str(cause["name"])),
            tuple(map(str, cause.get("evidence", ()))),
            float(cause["weight"]),
            str(cause.get("action", "")),
        )
        for cause in causes
    )
    main = found or (Cause(Wrong.UNDETERMINED),)
    if main[0].wrong is not Wrong.UNDETERMINED:
        return Finding(main, tuple(would_determine))
    open_ = tuple(would_determine) or tuple(filter(None, (main[0].advice,)))
    return Finding((replace(main[0], advice=""), *main[1:]), open_, is_sure=False)


def _unique(sentences: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(sentences))
