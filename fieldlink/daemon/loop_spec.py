"""What a loop is: all that gives its samples and its block their meaning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fieldlink.registers import Tag
from fieldlink.site import Device, Loop, Site

__all__ = ["LoopSpec"]

_NOT_ABOUT_SAMPLES = frozenset(
    {"writeback", "estimator", "estimate_every", "plant", "compensate", "area"}
)
"""Keys of a loop that leave its samples what they are."""

_NOT_ABOUT_VALUES = frozenset(
    {"timeout", "retry_after_max", "max_gap", "max_registers", "ranges", "quirks", "tls"}
)
"""Keys of a device that leave open neither which valve it is nor what its registers say."""


@dataclass(frozen=True)
class LoopSpec:
    """One loop of a site, with its device and the tags it reads.

    Attributes:
        name: the loop's name.
        loop: its settings.
        device: its device: the endpoint is part of what the loop is.
        tags: the tags that it reads, by name.
        speed: plant seconds per second of the wall clock.
    """

    name: str
    loop: Loop
    device: Device
    tags: Mapping[str, Tag]
    speed: float = 1.0

    @classmethod
    def of_site(cls, site: Site, name: str, *, live: bool = True) -> LoopSpec:
        """Return the specification of a loop of the site."""
        loop = site.loops[name]
        device = site.devices[loop.device]
        known = site.maps.get(loop.device, {})
        tags = {tag: known[tag] for tag in loop.tags if tag in known}
        return cls(name, loop, device, tags, device.speed if live else 1.0)

    @property
    def op_span(self) -> float | None:
        """Span of OP in its own units; None where the register map is silent."""
        tag = self.tags.get(self.loop.op)
        return None if tag is None else tag.output_span

    def has_samples_of(self, other: LoopSpec) -> bool:
        """Whether the samples of both mean the same, so that a window can go on."""
        return (
            self._values() == other._values()
            and self.tags == other.tags
            and self.speed == other.speed
            and _without(self.loop, _NOT_ABOUT_SAMPLES) == _without(other.loop, _NOT_ABOUT_SAMPLES)
        )

    def has_block_of(self, other: LoopSpec) -> bool:
        """Whether both write the same registers of the same PLC for the same valve."""
        mine, theirs = self.loop.writeback, other.loop.writeback
        return (
            self.has_samples_of(other)
            and mine.enabled
            and theirs.enabled
            and (mine.exchange, mine.loop_id) == (theirs.exchange, theirs.loop_id)
        )

    def _values(self) -> Mapping[str, object]:
        return _without(self.device, _NOT_ABOUT_VALUES)


def _without(model: Device | Loop, keys: frozenset[str]) -> Mapping[str, object]:
    return {key: value for key, value in dict(model).items() if key not in keys}
