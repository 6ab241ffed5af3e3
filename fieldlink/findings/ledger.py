"""The open findings of a site, and what each round of diagnoses makes of them.

    ledger = Ledger(open_before)
    rows = ledger.advance(round)          # what is new, to be stored and reported

A finding begins as watched, is confirmed when it is seen again, and closes with a reason. One
whose loop has no new window stays as it is: missing data neither confirm nor close it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from fieldlink.findings.matching import nearness
from fieldlink.findings.observed import ObservedLoop, Repair, Round
from fieldlink.findings.open_finding import OpenFinding, State, Trial
from fieldlink.findings.proposals import Proposal, propose
from fieldlink.findings.sentences import describe_finding, describe_follow_up, moment_text
from fieldlink.store import FindingRecord

__all__ = ["Ledger"]


@dataclass(frozen=True, slots=True)
class _Rules:
    confirm_after: int
    close_after: int


class Ledger:
    """Keeps the open findings of a site.

    Args:
        before: findings that an earlier process left open.
        confirm_after: diagnoses that must show a finding before it is confirmed.
        close_after: diagnoses in a row without it after which it is closed.
    """

    def __init__(
        self,
        before: Iterable[FindingRecord] = (),
        *,
        confirm_after: int = 2,
        close_after: int = 3,
    ) -> None:
        self._rules = _Rules(confirm_after, close_after)
        self._open = {one.id: one for one in map(OpenFinding.of_record, before)}

    @property
    def open(self) -> tuple[OpenFinding, ...]:
        """The findings that are not closed, the oldest first."""
        return tuple(self._open.values())

    def set_rules(self, *, confirm_after: int, close_after: int) -> None:
        """Take over changed settings."""
        self._rules = _Rules(confirm_after, close_after)

    def close_all(self, utc_ms: int, reason: str) -> list[FindingRecord]:
        """Close every finding and return their rows."""
        rows = [one.closed().record(utc_ms, reason) for one in self.open]
        self._open = {}
        return rows

    def rename(self, utc_ms: int, names: Mapping[str, str]) -> list[FindingRecord]:
        """Give loops their new names and return the rows of the findings about them.

        Args:
            utc_ms: the moment.
            names: the new name of each former one.
        """
        rows = []
        for found in self.open:
            renamed = found.renamed(names)
            if renamed != found:
                self._open[found.id] = renamed
                new = [f"{name} is {names[name]} now" for name in found.loops if name in names]
                rows.append(renamed.record(utc_ms, f"new names in the site file: {', '.join(new)}"))
        return rows

    def advance(self, now: Round) -> list[FindingRecord]:
        """Take a round and return the rows of every finding that changed by it."""
        step = _Step(now, self._open, self._rules)
        step.take()
        self._open = step.open
        return step.rows


class _Step:
    """One round's way through the open findings."""

    def __init__(self, now: Round, before: Mapping[str, OpenFinding], rules: _Rules) -> None:
        self.now, self.rules = now, rules
        self.open = dict(before)
        self.rows: list[FindingRecord] = []
        # a repair of tomorrow was noted by a clock that was wrong: no window begins after it
        self.repairs = {
            name: repair for name, repair in now.repairs.items() if repair.utc_ms <= now.utc_ms
        }
        # a window with samples from before a repair says nothing of the loop after it
        self.loops = {
            name: loop
            for name, loop in now.loops.items()
            if name not in self.repairs or self.repairs[name].utc_ms <= loop.begin_ms
        }

    def take(self) -> None:
        for found in list(self.open.values()):
            self._follow_the_site(found)
        for found in list(self.open.values()):
            self._follow_the_source(found)
        seen: set[str] = set()
        for proposal in propose(self.loops, self.now.groups):
            match = self._match(proposal)
            if match is None:
                match = self._bear(proposal)
            elif _is_follower_alone(match, proposal):
                # the group's finding covers it, and it does not show that the group still swings
                continue
            elif match.trial is None and match.id not in seen:
                self._see_again(match, proposal)
            seen.add(match.id)
            self._absorb(match.id, proposal, seen)
        for found in list(self.open.values()):
            if found.id not in seen:
                self._miss(found)

    # what happened to the loops -------------------------------------------------------------------

    def _follow_the_site(self, found: OpenFinding) -> None:
        """Close what is about loops that the site no longer has."""
        left = tuple(name for name in found.loops if name in self.now.known)
        if found.loop and found.loop not in left:
            self._close(found, f"the site has no loop {found.loop} any more")
        elif len(left) < min(2, len(found.loops)):
            self._close(found, "the site has too few of its loops left")
        elif left != found.loops:
            self.open[found.id] = replace(found, loops=left)

    def _follow_the_source(self, found: OpenFinding) -> None:
        """See whether the loop that has the cause was repaired or is in manual."""
        if not found.loop:
            return
        repair = self.repairs.get(found.loop)
        is_new = repair is not None and repair.utc_ms > found.born_ms
        if repair is not None and is_new and (found.trial is None or self._is_later(found, repair)):
            self._begin_trial(
                found, Trial(found.loop, repair.utc_ms, "repaired"), f": {repair.note}"
            )
            return
        loop = self.loops.get(found.loop)
        if found.trial is None and loop is not None and loop.cause(found.cause) is None:
            # a cause that shows in manual too, such as a bad transmitter, is not over
            if loop.is_in_manual and loop.manual_since_ms is not None:
                self._begin_trial(found, Trial(found.loop, loop.manual_since_ms, "in manual"), "")
        elif found.trial is not None:
            self._judge_trial(found, found.trial)

    @staticmethod
    def _is_later(found: OpenFinding, repair: Repair) -> bool:
        return found.trial is not None and repair.utc_ms > found.trial.utc_ms

    def _begin_trial(self, found: OpenFinding, trial: Trial, note: str) -> None:
        what = f"{trial.loop} was {trial.what} ({moment_text(trial.utc_ms)}){note}"
        if not found.is_group:
            self._close(found, what)
            return
        found = replace(found, trial=trial, missed=0)
        self._tell(found, f"{what}; the next whole windows of the others tell whether it was it")

    def _judge_trial(self, found: OpenFinding, trial: Trial) -> None:
        """Report how the others swing, once their windows are wholly after the change."""
        source = self.loops.get(trial.loop)
        if trial.what == "in manual" and source is not None and source.manual_since_ms is None:
            found = replace(found, trial=None)
            self._tell(
                found,
                f"{trial.loop} is back in automatic; the effect on the others is unknown",
            )
            return
        others = {
            name: loop
            for name in found.others
            if (loop := self.loops.get(name)) is not None and loop.begin_ms >= trial.utc_ms
        }
        if len(others) < len([name for name in found.others if name in self.loops]) or not others:
            return
        if trial.what == "in manual" and source is not None and not source.is_wholly_in_manual:
            return
        swinging = [n for n, loop in others.items() if loop.swings_with(found.swing_period_s)]
        calm = [name for name in others if name not in swinging]
        self._close(
            found,
            describe_follow_up(trial.loop, trial.what, trial.utc_ms, calm, swinging),
            followed={"calm": calm, "swinging": swinging},
        )

    # what is seen ---------------------------------------------------------------------------------

    def _match(self, proposal: Proposal) -> OpenFinding | None:
        """Return the open finding that the proposal is about; None where it is new."""
        best = max(self.open.values(), key=lambda one: nearness(one, proposal), default=None)
        return best if best is not None and nearness(best, proposal) > 0.0 else None

    def _bear(self, proposal: Proposal) -> OpenFinding:
        state = State.CONFIRMED if self.rules.confirm_after == 1 else State.WATCH
        found = OpenFinding(
            id=self._new_id(),
            born_ms=self.now.utc_ms,
            state=state,
            cause=proposal.cause,
            loop=proposal.loop,
            loops=proposal.loops,
            swing_period_s=proposal.swing_period_s,
            weight=proposal.weight,
            evidence=proposal.evidence,
            action=proposal.action,
            candidates=proposal.candidates,
            seen_ms=proposal.seen_ms,
        )
        self._tell(found, f"seen for the first time: {describe_finding(found)}")
        return found

    def _see_again(self, found: OpenFinding, proposal: Proposal) -> None:
        if found.is_group and found.loop and found.loop not in self.loops:
            # without a new window of the source nothing new is known of it, nor of the group
            return
        before = found
        found = replace(
            found,
            seen=found.seen + 1,
            missed=0,
            seen_ms=proposal.seen_ms,
            weight=proposal.weight,
            evidence=proposal.evidence,
            action=proposal.action,
        )
        if found.is_group and len(proposal.loops) == 1:
            found = self._see_source_alone(found)
        else:
            # those without a new window have neither left the group nor stayed in it
            silent = [name for name in found.others if name not in self.loops]
            more = [name for name in silent if found.is_group and name not in proposal.loops]
            found = replace(
                found,
                cause=proposal.cause,
                loop=proposal.loop,
                loops=(*proposal.loops, *more),
                swing_period_s=proposal.swing_period_s,
                candidates=proposal.candidates,
                alone=0,
            )
        said = describe_finding(found)
        if found.state is State.WATCH and found.seen >= self.rules.confirm_after:
            found = replace(found, state=State.CONFIRMED)
            self._tell(found, f"confirmed, seen in {found.seen} diagnoses: {said}")
        elif (found.cause, found.loop, set(found.loops)) != (
            before.cause,
            before.loop,
            set(before.loops),
        ):
            self._tell(found, f"changed: {said}; before: {describe_finding(before)}")
        else:
            self.open[found.id] = found

    def _see_source_alone(self, found: OpenFinding) -> OpenFinding:
        """Return a group whose source shows by itself; it is none once the others stay calm."""
        judged = [self.loops[name] for name in found.others if name in self.loops]
        if not judged:
            return found
        if any(loop.swings_with(found.swing_period_s) for loop in judged):
            return replace(found, alone=0)
        found = replace(found, alone=found.alone + 1)
        if found.alone < self.rules.close_after:
            return found
        return replace(found, loops=(found.loop,), candidates=(), alone=0)

    def _absorb(self, into: str, proposal: Proposal, seen: set[str]) -> None:
        """Close the findings of single loops that turn out to be one group's."""
        if len(proposal.loops) < 2:
            return
        for other in list(self.open.values()):
            is_single = other.id != into and not other.is_group and other.id not in seen
            if is_single and (other.loop, other.cause) in proposal.covers:
                self._close(other, f"part of finding {into}: {describe_finding(proposal)}")

    # what is not seen -----------------------------------------------------------------------------

    def _miss(self, found: OpenFinding) -> None:
        if not self._has_a_say(found):
            return
        found = replace(found, missed=found.missed + 1)
        if found.missed < self.rules.close_after:
            self.open[found.id] = found
            return
        again = "" if found.state is State.CONFIRMED else "it never came again: "
        self._close(found, f"{again}not seen in {found.missed} diagnoses in a row")

    def _has_a_say(self, found: OpenFinding) -> bool:
        """Whether this round judged enough loops of the finding to have shown it."""
        if found.trial is not None:
            begun = found.trial.utc_ms
            others = [self.loops[name] for name in found.others if name in self.loops]
            return any(loop.begin_ms >= begun for loop in others)
        if found.loop:
            loop = self.loops.get(found.loop)
            return loop is not None and not _is_hidden(found, loop)
        return 2 * len([name for name in found.loops if name in self.loops]) >= len(found.loops)

    # rows -----------------------------------------------------------------------------------------

    def _tell(self, found: OpenFinding, message: str) -> None:
        self.open[found.id] = found
        self.rows.append(found.record(self.now.utc_ms, message))

    def _close(
        self,
        found: OpenFinding,
        reason: str,
        *,
        followed: Mapping[str, list[str]] | None = None,
    ) -> None:
        self.open.pop(found.id, None)
        self.rows.append(found.closed().record(self.now.utc_ms, reason, followed=followed))

    def _new_id(self) -> str:
        """Return an id that no finding of another round can have."""
        moment = datetime.fromtimestamp(self.now.utc_ms / 1000.0, UTC)
        taken = {row.finding for row in self.rows} | set(self.open)
        number = 1
        while (found := f"{moment:%Y%m%d-%H%M%S}-{number}") in taken:
            number += 1
        return found


def _is_follower_alone(found: OpenFinding, proposal: Proposal) -> bool:
    """Whether a proposal is one loop of a group other than its source."""
    is_source = (proposal.loop, proposal.cause) == (found.loop, found.cause)
    return found.is_group and len(proposal.loops) == 1 and not is_source


def _is_hidden(found: OpenFinding, loop: ObservedLoop) -> bool:
    """Whether a compensator may hide the sticky valve: it still sticks."""
    return found.cause == "sticky_valve" and loop.compensated
