"""What recorded data say of proposed loops, for ``fieldlink init``: shown, and then asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fieldlink.site.loop_proposal import LoopProposal
    from fieldlink.site.role_evidence import RoleEvidence

__all__ = ["RecordedTags", "doubt_loop", "propose_roles"]

Roles = Mapping[str, str]


class RecordedTags:
    """A recorded file whose columns have the names of tags.

    Args:
        path: CSV file with a header.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[tuple[str, str], RoleEvidence | None] = {}

    def judge(self, op: str, pv: str) -> RoleEvidence | None:
        """Return what the data say of two tags; None when one of them is not in the file.

        Raises:
            RecordingError: the file cannot be read.
        """
        from fieldlink.site import read_recording
        from fieldlink.site.recorded_table import read_recorded_table
        from fieldlink.site.role_evidence import judge_roles

        if (op, pv) not in self._known:
            header = set(read_recorded_table(self._path, (op, pv)).file.header)
            if {op, pv} <= header:
                found = read_recording(self._path, op=op, pv=pv)
                self._known[op, pv] = judge_roles(found.op, found.pv)
            else:
                self._known[op, pv] = None
        return self._known[op, pv]


def propose_roles(
    loop: LoopProposal, recorded: RecordedTags, say: Callable[[str], None]
) -> dict[str, str]:
    """Show which roles the data of an unclear loop support; return them.

    A pair of tags is supported when no other pair agrees with the data as well.
    """
    from fieldlink.site.role_evidence import Roles as Found

    choices = {role: _choices(loop, role) for role in ("op", "pv")}
    agreeing = []
    for op, pv in product(choices["op"], choices["pv"]):
        if op == pv or (found := recorded.judge(op, pv)) is None:
            continue
        say(f"  data: OP {op}, PV {pv}: {found.sentence}")
        if found.roles is Found.AGREE:
            agreeing.append({"op": op, "pv": pv})
    return agreeing[0] if len(agreeing) == 1 else {}


def doubt_loop(
    name: str, roles: Roles, recorded: RecordedTags, say: Callable[[str], None]
) -> LoopProposal | None:
    """Show what the data say of a clear loop; return it as a question when they contradict."""
    from fieldlink.site.loop_proposal import LoopProposal
    from fieldlink.site.role_evidence import Roles as Found

    found = recorded.judge(roles["op"], roles["pv"])
    if found is None:
        return None
    say(f"  data: {name}: {found.sentence}")
    if found.roles is not Found.SWAPPED:
        return None
    pair = (roles["op"], roles["pv"])
    rest = {role: tag for role, tag in roles.items() if role not in ("op", "pv")}
    return LoopProposal(name, rest, {"op": pair[::-1], "pv": pair})


def _choices(loop: LoopProposal, role: str) -> tuple[str, ...]:
    return (loop.roles[role],) if role in loop.roles else loop.unclear.get(role, ())
