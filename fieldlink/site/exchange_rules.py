"""What must hold between the exchange areas of a site, and between them and the mapped tags.

A PLC may have hundreds of loops and thousands of tags: only neighbours are compared.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

from fieldlink.registers import Table, Tag
from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem
from fieldlink.site.toml_source import TomlSource

__all__ = ["exchange_areas_fit"]


@dataclass(frozen=True, slots=True)
class _Area:
    """One part of a loop's exchange area: addresses ``first`` to ``last`` of an endpoint.

    ``order`` is that of the loop on its endpoint, and of the part in its area.
    """

    order: tuple[int, int]
    loop: str
    part: str
    first: int
    last: int

    def __str__(self) -> str:
        span = str(self.first) if self.first == self.last else f"{self.first} to {self.last}"
        return f"{self.part} ({span})"


class _Endpoint:
    """One unit of one PLC: two devices of a site file that are one have one set of registers."""

    def __init__(self) -> None:
        self.areas: list[list[_Area]] = []
        self._tags: list[Tag] = []
        self._sorted: list[tuple[int, int]] = []
        self._longest = 0

    def add_loop(self, name: str, spans: tuple[tuple[str, int, int], ...]) -> None:
        """Take the parts of a loop's exchange area."""
        order = len(self.areas)
        self.areas.append([_Area((order, i), name, *span) for i, span in enumerate(spans)])

    def add_tag(self, tag: Tag) -> None:
        """Take a tag of holding registers."""
        self._sorted.append((tag.address, len(self._tags)))
        self._tags.append(tag)
        self._longest = max(self._longest, tag.end - tag.address)

    def sort(self) -> None:
        """Put the tags in order: to be called when all are there."""
        self._sorted.sort()

    def overlaps(self, areas: list[_Area]) -> list[tuple[Tag, _Area]]:
        """Return the tags that lie in the areas of a loop, in the order of the maps."""
        found = []
        for number, area in enumerate(areas):
            begin = bisect_left(self._sorted, (area.first - self._longest, 0))
            end = bisect_right(self._sorted, (area.last, len(self._tags)))
            found += [
                (place, number)
                for _, place in self._sorted[begin:end]
                if area.first < self._tags[place].end
            ]
        return [(self._tags[place], areas[number]) for place, number in sorted(found)]

    def clashes(self) -> list[tuple[_Area, _Area]]:
        """Return a pair of areas that share registers for each two loops that have one.

        Each pair begins with that of the loop further down in the site file.
        """
        first_of: dict[tuple[int, int], tuple[_Area, _Area]] = {}
        open_areas: list[_Area] = []
        for area in sorted((a for areas in self.areas for a in areas), key=lambda a: a.first):
            open_areas = [other for other in open_areas if other.last >= area.first]
            for other in open_areas:
                if other.loop != area.loop:
                    pair = tuple(sorted((area, other), key=lambda a: a.order, reverse=True))
                    key = (pair[0].order[0], pair[1].order[0])
                    known = first_of.get(key)
                    if known is None or _orders(pair) < _orders(known):
                        first_of[key] = (pair[0], pair[1])
            open_areas.append(area)
        return [first_of[key] for key in sorted(first_of)]


def _orders(pair: tuple[_Area, ...]) -> list[tuple[int, int]]:
    return [area.order for area in pair]


def exchange_areas_fit(site: Site, source: TomlSource) -> Iterator[Problem]:
    """Yield where areas overlap each other or tags, lie outside of ranges, or share a number."""
    key_of = {name: device.endpoint or (name,) for name, device in site.devices.items()}
    endpoints = {key: _Endpoint() for key in key_of.values()}
    for name, device in site.devices.items():
        for tag in () if device.is_opcua else site.maps.get(name, {}).values():
            if tag.table is Table.HOLDING:
                endpoints[key_of[name]].add_tag(tag)
    for endpoint in endpoints.values():
        endpoint.sort()
    numbers: dict[tuple[object, ...], str] = {}
    for name, loop in site.loops.items():
        layout = loop.writeback.exchange
        if loop.device not in key_of or layout is None:
            continue
        endpoint = endpoints[key_of[loop.device]]
        endpoint.add_loop(name, tuple(layout.spans()))
        yield from _area_is_free(site, source, name, endpoint)
        number = loop.writeback.loop_id
        other = numbers.setdefault((key_of[loop.device], number), name)
        if other != name:
            yield source.problem(
                ("loops", name, "writeback", "loop_id"),
                f"{number} is the loop_id of {other} too",
                "give each loop of a PLC its own",
            )
    for endpoint in endpoints.values():
        for area, taken in endpoint.clashes():
            yield source.problem(
                ("loops", area.loop, "writeback", "base"),
                f"{area} shares registers with {taken} of {taken.loop}",
                "two loops must not write one block: move one of the areas",
            )


def _area_is_free(
    site: Site, source: TomlSource, name: str, endpoint: _Endpoint
) -> Iterator[Problem]:
    """Yield what is wrong with the areas of the loop that the endpoint has taken last."""
    key = ("loops", name, "writeback", "base")
    device_name = site.loops[name].device
    areas, mine = endpoint.areas[-1], site.devices[device_name]
    for tag, area in endpoint.overlaps(areas):
        yield source.problem(
            key,
            f"{area} overlaps the tag {tag.name} ({tag.address} to {tag.end - 1})",
            "move the exchange area or the tag",
        )
    for area in areas:
        inside = any(first <= area.first and area.last <= last for first, last in mine.ranges)
        if mine.ranges and not inside:
            yield source.problem(
                key,
                f"{area} is not inside one of the declared ranges of {device_name!r}",
                "move the exchange area or extend the ranges",
            )
            return
