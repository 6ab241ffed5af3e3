"""The life of a finding, told by rounds of diagnoses: born, confirmed, grown, closed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from fieldlink.findings import (
    CauseSeen,
    Ledger,
    ObservedGroup,
    ObservedLoop,
    Repair,
    Round,
    describe_finding,
)
from fieldlink.store import FindingRecord

HOUR = 3_600_000
SITE = frozenset({"A", "B", "C", "D"})


def loop(hour: int, *causes: str, period: float | None = None, **more: Any) -> ObservedLoop:
    """A loop's window that ends at an hour and began half an hour before."""
    seen = tuple(CauseSeen(name, 0.6, (f"evidence of {name}",), "act") for name in causes)
    return ObservedLoop(hour * HOUR - HOUR // 2, hour * HOUR, seen, period, **more)


def group(*loops: str, source: str | None, period: float = 90.0) -> ObservedGroup:
    candidates = [source, *(name for name in (*loops, None) if name != source)]
    return ObservedGroup(
        loops,
        period,
        tuple(
            {"loop": one, "weight": 0.7 - 0.1 * k, "evidence": ["for"], "against": ["against"]}
            for k, one in enumerate(candidates)
        ),
    )


def at(hour: int, loops: dict[str, ObservedLoop], *groups: ObservedGroup, **more: Any) -> Round:
    return Round(hour * HOUR, loops, **({"known": SITE} | more), groups=groups)


def swinging(hour: int, source: str = "A", *others: str) -> Round:
    """A round in which others swing with a sticky valve."""
    loops = {source: loop(hour, "sticky_valve", period=90.0)}
    loops |= {name: loop(hour, "external_oscillation", period=91.0) for name in others}
    return at(hour, loops, group(source, *others, source=source))


def confirmed(*rounds: Round) -> tuple[Ledger, FindingRecord]:
    """A ledger with one confirmed finding, and its row."""
    ledger = Ledger()
    rows = [row for one in rounds for row in ledger.advance(one)]
    assert [row.state for row in rows] == ["watch", "confirmed"]
    return ledger, rows[-1]


def test_a_finding_is_confirmed_when_it_comes_again_and_closes_when_it_is_gone() -> None:
    ledger = Ledger(close_after=2)
    states = []
    for hour in range(1, 6):
        tight = hour < 4
        rows = ledger.advance(at(hour, {"A": loop(hour, "tight_tuning" if tight else "quiet")}))
        states.append([(row.state, row.finding) for row in rows])
    (born,), (again,), third, fourth, (over,) = states
    assert (born[0], again[0], over[0]) == ("watch", "confirmed", "closed")
    assert born[1] == again[1] == over[1]
    assert third == fourth == []
    assert ledger.open == ()


def test_causes_without_an_action_are_no_findings() -> None:
    ledger = Ledger()
    assert ledger.advance(at(1, {"A": loop(1, "quiet"), "B": loop(1, "undetermined")})) == []


def test_one_finding_for_a_group_and_none_for_its_victims() -> None:
    ledger, row = confirmed(swinging(1, "A", "B", "C"), swinging(2, "A", "B", "C"))
    assert (row.loop, row.cause, row.loops) == ("A", "sticky_valve", ("A", "B", "C"))
    assert row.document is not None
    assert row.document["candidates"][0]["loop"] == "A"  # type: ignore[index]
    assert describe_finding(row) == "candidate A: sticky valve; B and C swing with it every 90 s"
    assert len(ledger.open) == 1


def test_what_one_loop_makes_with_several_periods_is_one_finding() -> None:
    twice = swinging(1, "A", "B")
    harmonic = replace(twice.groups[0], period_s=31.0)
    (row,) = Ledger().advance(replace(twice, groups=(*twice.groups, harmonic)))
    assert row.swing_period_s == 90.0


def test_findings_of_single_loops_become_one_when_their_group_shows() -> None:
    ledger = Ledger()
    alone = swinging(1, "A", "B")
    first = ledger.advance(replace(alone, groups=()))
    assert [(row.loop, row.cause) for row in first] == [
        ("A", "sticky_valve"),
        ("B", "external_oscillation"),
    ]
    rows = ledger.advance(swinging(2, "A", "B"))
    assert [(row.finding, row.state) for row in rows] == [
        (first[0].finding, "confirmed"),
        (first[1].finding, "closed"),
    ]
    assert f"part of finding {first[0].finding}" in rows[1].message
    # a round in which the group does not show makes no new findings of its members
    assert ledger.advance(replace(swinging(3, "A", "B"), groups=())) == []


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ({"B": "quiet", "C": "quiet"}, "B and C no longer swing: it was the source"),
        ({"B": "quiet", "C": "external_oscillation"}, "B no longer swings; C still does"),
        (
            {"B": "external_oscillation", "C": "external_oscillation"},
            "B and C still swing: look elsewhere",
        ),
    ],
)
@pytest.mark.parametrize("what", ["repaired", "in manual"])
def test_after_the_candidate_is_repaired_or_in_manual_the_others_tell(
    what: str, others: dict[str, str], said: str
) -> None:
    ledger, row = confirmed(swinging(1, "A", "B", "C"), swinging(2, "A", "B", "C"))
    changed = 3 * HOUR - HOUR // 4
    repairs = {"A": Repair(changed, "packing replaced")} if what == "repaired" else {}

    def then(hour: int) -> Round:
        source = loop(hour, "quiet")
        if what == "in manual":
            source = loop(hour, "manual", manual_since_ms=changed)
            source = replace(source, causes=(replace(source.causes[0], weight=1.0),))
        loops = {"A": source}
        loops |= {
            name: loop(hour, cause, period=90.0 if cause != "quiet" else None)
            for name, cause in others.items()
        }
        return at(hour, loops, repairs=repairs)

    def of_the_group(now: Round) -> FindingRecord:
        """The group's row; a loop in manual is a finding of its own."""
        (found,) = [one for one in ledger.advance(now) if one.finding == row.finding]
        return found

    # windows that reach back before the change tell nothing yet
    mixed = replace(swinging(3, "A", "B", "C"), repairs=repairs)
    if what == "in manual":
        mixed = replace(mixed, loops={**mixed.loops, "A": then(3).loops["A"]})
    begun = of_the_group(mixed)
    assert begun.state == "confirmed"
    assert "the next whole windows of the others tell" in begun.message
    closed = of_the_group(then(4))
    assert closed.state == "closed"
    assert said in closed.message
    assert f"A was {what}" in closed.message
    assert closed.document is not None
    assert closed.document["followed"] == {
        "calm": [name for name, cause in others.items() if cause == "quiet"],
        "swinging": [name for name, cause in others.items() if cause != "quiet"],
    }


def test_a_repaired_or_manual_loop_closes_its_own_finding_with_the_reason() -> None:
    tight = [at(hour, {"A": loop(hour, "tight_tuning")}) for hour in (1, 2, 3)]
    ledger, _ = confirmed(*tight[:2])
    repair = {"A": Repair(3 * HOUR - HOUR // 4, "retuned by Meyer")}
    (closed,) = ledger.advance(replace(tight[2], repairs=repair))
    assert closed.state == "closed"
    assert "A was repaired" in closed.message
    assert "retuned by Meyer" in closed.message
    # what comes after the repair is a finding of its own
    (anew,) = ledger.advance(replace(at(5, {"A": loop(5, "tight_tuning")}), repairs=repair))
    assert anew.state == "watch"
    assert anew.finding != closed.finding

    ledger, _ = confirmed(*tight[:2])
    manual = loop(3, "manual", manual_since_ms=3 * HOUR - HOUR // 4)
    rows = ledger.advance(at(3, {"A": manual}))
    assert [(row.cause, row.state) for row in rows] == [
        ("tight_tuning", "closed"),
        ("manual", "watch"),
    ]
    assert "A was in manual" in rows[0].message


def test_a_loop_without_news_or_behind_a_compensator_loses_no_finding() -> None:
    ledger, row = confirmed(*(at(h, {"A": loop(h, "sticky_valve")}) for h in (1, 2)))
    for hour in range(3, 9):
        assert ledger.advance(at(hour, {"B": loop(hour, "quiet")})) == []
        hidden = loop(hour, "quiet", compensated=True)
        assert ledger.advance(at(hour, {"A": hidden})) == []
    assert [one.id for one in ledger.open] == [row.finding]
    (closed,) = ledger.advance(at(9, {}, known=frozenset({"B"})))
    assert closed.message == "the site has no loop A any more"


def test_a_restart_goes_on_with_what_is_open() -> None:
    ledger = Ledger()
    (born,) = ledger.advance(swinging(1, "A", "B"))
    (again,) = Ledger([born]).advance(swinging(2, "A", "B"))
    assert (again.finding, again.state, again.born_ms) == (born.finding, "confirmed", HOUR)


def test_a_source_that_turns_out_to_be_another_stays_one_finding() -> None:
    ledger, row = confirmed(swinging(1, "A", "B", "C"), swinging(2, "A", "B", "C"))
    other = replace(swinging(3, "A", "B", "C"), groups=(group("A", "B", "C", "D", source=None),))
    other = replace(other, loops={**other.loops, "D": loop(3, "quiet", period=90.0)})
    (changed,) = [r for r in ledger.advance(other) if r.finding == row.finding]
    assert changed.message.startswith("changed: A, B, C and D swing together every 90 s")
    assert (changed.loop, changed.state) == ("", "confirmed")


def test_what_shows_in_manual_too_is_not_over_in_manual() -> None:
    broken = [at(hour, {"A": loop(hour, "sensor")}) for hour in (1, 2)]
    ledger, row = confirmed(*broken)
    states = []
    for hour in range(3, 9):
        seen = loop(hour, "manual", "sensor", manual_since_ms=5 * HOUR // 2)
        states += [(one.cause, one.state) for one in ledger.advance(at(hour, {"A": seen}))]
    assert states == [("manual", "watch"), ("manual", "confirmed")]
    assert row.finding in {one.id for one in ledger.open}


def test_a_group_keeps_a_source_without_a_new_window() -> None:
    ledger, _ = confirmed(swinging(1, "A", "B", "C"), swinging(2, "A", "B", "C"))
    for hour in range(3, 9):
        now = swinging(hour, "A", "B", "C")
        if hour % 2:
            others = {name: seen for name, seen in now.loops.items() if name != "A"}
            now = at(hour, others, group("B", "C", source=None))
        assert ledger.advance(now) == []
    (one,) = ledger.open
    assert (one.loop, one.loops) == ("A", ("A", "B", "C"))


def test_a_member_without_a_new_window_stays_in_its_group() -> None:
    ledger, _ = confirmed(swinging(1, "A", "B", "C"), swinging(2, "A", "B", "C"))
    for hour in range(3, 9):
        # C's windows are twice as long as the others'
        assert ledger.advance(swinging(hour, "A", "B", *("C" if hour % 2 == 0 else ""))) == []
    (one,) = ledger.open
    assert set(one.loops) == {"A", "B", "C"}


def test_a_group_whose_others_stay_calm_is_its_source_alone() -> None:
    ledger, row = confirmed(swinging(1, "A", "B", "C"), swinging(2, "A", "B", "C"))
    told = []
    for hour in range(3, 9):
        alone = {"A": loop(hour, "sticky_valve", period=90.0)}
        alone |= {name: loop(hour, "quiet") for name in "BC"}
        told += ledger.advance(at(hour, alone))
    (changed,) = told
    assert (changed.finding, changed.loops) == (row.finding, ("A",))
    assert changed.message.startswith("changed: A: sticky valve, swings every 90 s; before: cand")


@pytest.mark.parametrize("source", ["A", None])
def test_one_loop_that_still_swings_does_not_keep_its_group(source: str | None) -> None:
    rounds = [swinging(hour, "A", "B", "C") for hour in (1, 2)]
    ledger = Ledger()
    for one in rounds:
        ledger.advance(replace(one, groups=(group("A", "B", "C", source=source),)))
    (found,) = [one for one in ledger.open if one.is_group]
    told = []
    for hour in range(3, 9):
        left = {name: loop(hour, "quiet") for name in "AC"}
        left["B"] = loop(hour, "external_oscillation", period=90.0)
        told += ledger.advance(at(hour, left))
    of_group = [row for row in told if row.finding == found.id]
    assert [row.state for row in of_group] == ["closed"]
    # what goes on there is a finding of its own
    assert [(one.loops, one.state.value) for one in ledger.open] == [(("B",), "confirmed")]


def test_a_renamed_loop_keeps_its_finding_and_its_trial() -> None:
    ledger, row = confirmed(swinging(1, "A", "B", "C"), swinging(2, "A", "B", "C"))
    mixed = replace(swinging(3, "A", "B", "C"), repairs={"A": Repair(3 * HOUR, "packing")})
    assert "repaired" in ledger.advance(mixed)[0].message
    (told,) = ledger.rename(4 * HOUR, {"A": "FIC101", "Z": "Y"})
    assert (told.finding, told.loop, told.loops) == (row.finding, "FIC101", ("FIC101", "B", "C"))
    assert told.document is not None
    assert told.document["candidates"][0]["loop"] == "FIC101"  # type: ignore[index]
    assert ledger.rename(4 * HOUR, {"Z": "Y"}) == []
    calm = {name: loop(5, "quiet") for name in ("FIC101", "B", "C")}
    (closed,) = ledger.advance(at(5, calm, known=frozenset(calm)))
    assert "since FIC101 was repaired" in closed.message
    assert "it was the source" in closed.message


def test_a_repair_noted_by_a_clock_that_was_ahead_hides_no_loop() -> None:
    repairs = {"A": Repair(10_000 * HOUR, "packing replaced")}
    ledger = Ledger()
    rounds = [at(h, {"A": loop(h, "sticky_valve")}, repairs=repairs) for h in (1, 2)]
    rows = [row for one in rounds for row in ledger.advance(one)]
    assert [row.state for row in rows] == ["watch", "confirmed"]


@pytest.mark.parametrize(
    ("period", "said"),
    [
        (74.3, "FC101: sticky valve, swings every 74 s"),
        (4.26, "FC101: sticky valve, swings every 4.3 s"),
        (None, "FC101: sticky valve"),
    ],
)
def test_a_period_is_said_in_words(period: float | None, said: str) -> None:
    found = SimpleNamespace(
        cause="sticky_valve", loop="FC101", loops=("FC101",), swing_period_s=period
    )
    assert describe_finding(found) == said
