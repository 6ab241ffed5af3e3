"""Which nodes of an OPC UA server share a Read request: a loop's tags always do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from fieldlink.registers import ReadRequest, Table, Tag
from fieldlink.site.models import Loop
from fieldlink.site.polling import polls_by_tag

__all__ = ["plan_nodes"]


def plan_nodes(
    tags: Mapping[str, Tag], loops: Iterable[Loop], max_nodes: int
) -> tuple[ReadRequest, ...]:
    """Return the Read requests of a scan: every tag once, those of a loop together.

    Args:
        tags: of the device, by name.
        loops: of the device.
        max_nodes: most nodes in one request.
    """
    every = list(loops)
    polls = polls_by_tag(every)
    groups: dict[int, list[list[Tag]]] = {}
    taken: set[str] = set()
    for loop in every:
        mine = [tags[name] for name in loop.tags if name in tags and name not in taken]
        taken.update(tag.name for tag in mine)
        groups.setdefault(polls.get(loop.pv, 1), []).append(mine)
    groups.setdefault(1, []).extend([tag] for name, tag in tags.items() if name not in taken)
    found: list[ReadRequest] = []
    for rate, members in groups.items():
        batch: list[Tag] = []
        for mine in members:
            if batch and len(batch) + len(mine) > max_nodes:
                found.append(_request(batch, rate))
                batch = []
            batch.extend(mine)
        if batch:
            found.append(_request(batch, rate))
    return tuple(found)


def _request(tags: list[Tag], polls: int) -> ReadRequest:
    first = min(tag.address for tag in tags)
    return ReadRequest(Table.HOLDING, first, len(tags), tuple(tags), polls=polls)
