"""A changed site file: what it changes, and noticing that it has changed.

Only what a change touches is started again. A loop whose samples come from where they came before
keeps its window, whatever else changes on its device.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from fieldlink.daemon.loop_spec import LoopSpec
from fieldlink.file_at import stamp_of_file
from fieldlink.site import Site

__all__ = ["FileWatch", "SiteChange", "same_samples"]

_AT_THE_START = ("historian", "estimation", "web", "mqtt", "opcua_server", "notify")


@dataclass(frozen=True, slots=True)
class SiteChange:
    """The difference between two sites; names of devices that have loops.

    Attributes:
        added, removed, changed: devices to start, to end, and to start again.
        changed_loops: by changed device, the loops that alone are the reason.
        new_loops, gone_loops: loops of one of the sites only.
        kept_loops: loops on changed devices whose windows go on.
        restart: keys that take effect when the daemon is started again.
    """

    added: tuple[str, ...]
    removed: tuple[str, ...]
    changed: tuple[str, ...]
    changed_loops: Mapping[str, tuple[str, ...]]
    new_loops: frozenset[str]
    gone_loops: frozenset[str]
    kept_loops: tuple[str, ...]
    restart: tuple[str, ...]

    @classmethod
    def between(cls, old: Site, new: Site) -> SiteChange:
        """Compare two sites."""
        before, after = _used(old), _used(new)
        changed = tuple(
            name for name in after if name in before and not _same_device(old, new, name)
        )
        kept = tuple(
            loop for name in changed for loop in new.loops_of(name) if same_samples(old, new, loop)
        )
        restart = [key for key in _AT_THE_START if getattr(old.file, key) != getattr(new.file, key)]
        if old.data_dir != new.data_dir:
            restart.append("site.data_dir")
        return cls(
            added=tuple(name for name in after if name not in before),
            removed=tuple(name for name in before if name not in after),
            changed=changed,
            changed_loops={
                name: _differing_loops(old, new, name)
                for name in changed
                if _same_wire(old, new, name)
            },
            new_loops=frozenset(new.loops) - frozenset(old.loops),
            gone_loops=frozenset(old.loops) - frozenset(new.loops),
            kept_loops=kept,
            restart=tuple(restart),
        )

    @property
    def touches_devices(self) -> bool:
        """Whether any device has to be started, ended or started again."""
        return bool(self.added or self.removed or self.changed)

    def __str__(self) -> str:
        """Say it in a line."""
        parts = [
            f"{what} {', '.join(names)}"
            for what, names in (
                ("new:", self.added),
                ("gone:", self.removed),
                ("changed:", [self._name_change(name) for name in self.changed]),
                ("windows kept:", self.kept_loops),
                ("at the next start:", self.restart),
            )
            if names
        ]
        return "; ".join(parts) or "nothing that matters has changed"

    def _name_change(self, device: str) -> str:
        loops = self.changed_loops.get(device)
        if not loops:
            return device
        named = " and ".join(
            f"{loop} (new)"
            if loop in self.new_loops
            else f"{loop} (gone)"
            if loop in self.gone_loops
            else loop
            for loop in loops
        )
        return f"loop{'s' if len(loops) > 1 else ''} {named} of {device}"


class FileWatch:
    """Tells when the files of a site have changed and have come to rest.

    Args:
        site: the site whose files are watched.
    """

    def __init__(self, site: Site) -> None:
        self._paths = _files(site)
        self._known = self._seen = self._look()

    def changed(self) -> bool:
        """Look once; True when a change was seen at the look before and nothing since."""
        now = self._look()
        settled, self._seen = now == self._seen, now
        return settled and now != self._known

    def accept(self) -> None:
        """Remember the present state of the files; call it before they are read."""
        self._known = self._seen = self._look()

    def follow(self, site: Site) -> None:
        """Watch the files of another site; those watched before keep what is known of them."""
        self._paths = _files(site)
        self._known = self._look() | {
            path: stamp for path, stamp in self._known.items() if path in self._paths
        }
        self._seen = self._known

    def _look(self) -> dict[Path, tuple[int, ...] | None]:
        return {path: stamp_of_file(path) for path in self._paths}


def same_samples(old: Site, new: Site, loop: str) -> bool:
    """Whether a loop's samples mean the same in both sites, so that its window can go on."""
    if loop not in old.loops or loop not in new.loops:
        return False
    return LoopSpec.of_site(new, loop).has_samples_of(LoopSpec.of_site(old, loop))


def _used(site: Site) -> list[str]:
    return list(dict.fromkeys(loop.device for loop in site.loops.values()))


def _same_device(old: Site, new: Site, name: str) -> bool:
    return _same_wire(old, new, name) and old.loops_of(name) == new.loops_of(name)


def _same_wire(old: Site, new: Site, name: str) -> bool:
    return old.devices[name] == new.devices[name] and dict(old.maps.get(name, {})) == dict(
        new.maps.get(name, {})
    )


def _differing_loops(old: Site, new: Site, name: str) -> tuple[str, ...]:
    before, after = old.loops_of(name), new.loops_of(name)
    return tuple(loop for loop in {**before, **after} if before.get(loop) != after.get(loop))


def _files(site: Site) -> tuple[Path, ...]:
    maps: Iterable[Path] = (
        site.resolve(device.register_map)
        for device in site.devices.values()
        if device.register_map is not None
    )
    return (site.path, *maps)
