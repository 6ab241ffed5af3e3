"""A site as the rest of the program uses it: the site file, its register maps, its paths."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from fieldlink.registers import ReadRequest, Tag, plan_reads
from fieldlink.site.daemon_tables import (
    EstimationSettings,
    HistorianTable,
    ReportSettings,
    WebSettings,
)
from fieldlink.site.device import Device
from fieldlink.site.errors import Problem, SiteError
from fieldlink.site.models import Loop, SiteFile
from fieldlink.site.node_plan import plan_nodes
from fieldlink.site.polling import poll_period, polls_by_tag
from fieldlink.sqlite_url import SQLITE, sqlite_url

__all__ = ["Site"]

M = TypeVar("M", bound=BaseModel)

_PASSWORD = re.compile(r"(\w+://[^\s:/@]*):.+@")
"""Up to the last @, because a password may hold /, @ and blanks."""


@dataclass(frozen=True, slots=True)
class Site:
    """A checked site.

    Attributes:
        path: the site file.
        file: its content.
        maps: device name to its tags by name; a device without a register map has none.
    """

    path: Path
    file: SiteFile
    maps: Mapping[str, Mapping[str, Tag]]

    @property
    def name(self) -> str:
        """The site's name."""
        return self.file.site.name

    @property
    def devices(self) -> Mapping[str, Device]:
        """Devices by name."""
        return self.file.devices

    @property
    def loops(self) -> Mapping[str, Loop]:
        """Loops by name."""
        return self.file.loops

    @property
    def historian(self) -> HistorianTable:
        """The historian's settings."""
        return self.file.historian

    @property
    def estimation(self) -> EstimationSettings:
        """The settings of the estimator's processes."""
        return self.file.estimation

    @property
    def web(self) -> WebSettings:
        """The settings of the endpoints for health and metrics."""
        return self.file.web

    @property
    def report(self) -> ReportSettings:
        """The settings of the work list."""
        return self.file.report

    @property
    def data_dir(self) -> Path:
        """The folder for what Fieldlink writes."""
        return self.resolve(self.file.site.data_dir)

    @property
    def historian_url(self) -> str:
        """The historian's URL; a relative SQLite path is resolved against `data_dir`."""
        url = self.historian.url
        path = url.removeprefix(SQLITE)
        if path == url or path in ("", ":memory:") or Path(path).is_absolute():
            return url
        return f"{sqlite_url(self.data_dir)}/{path}"

    @property
    def historian_shown(self) -> str:
        """The historian's URL as it may be shown: without a password."""
        return _PASSWORD.sub(r"\1:***@", self.historian_url)

    def resolve(self, path: str | Path) -> Path:
        """Return a path of the site file, which is relative to the file's folder."""
        return self.path.parent / path

    def loops_of(self, device: str) -> Mapping[str, Loop]:
        """Return the loops on a device by name."""
        return {name: loop for name, loop in self.loops.items() if loop.device == device}

    def tag(self, loop: str, role: str) -> Tag | None:
        """Return the tag of a loop's ``role`` (op, pv, sp, mode, scan); None when it has none."""
        found = self.loops[loop]
        name = getattr(found, role)
        return None if name is None else self.maps.get(found.device, {}).get(name)

    def op_span(self, loop: str) -> float | None:
        """Return the span of a loop's OP in its own units; None where the map is silent."""
        tag = self.tag(loop, "op")
        return None if tag is None else tag.output_span

    def together(self, device: str) -> tuple[tuple[str, ...], ...]:
        """Return the groups of tags that should share a request, the most important first.

        OP and PV of each loop, then those with the scan counter, then all tags of each loop.
        """
        loops = self.loops_of(device).values()
        pairs = [(loop.op, loop.pv) for loop in loops]
        counted = [(loop.op, loop.pv, loop.scan) for loop in loops if loop.scan is not None]
        return (*pairs, *counted, *(loop.tags for loop in loops))

    def requests(self, device: str) -> tuple[ReadRequest, ...]:
        """Return the read plan of a device: every mapped tag once, each loop's tags together.

        Loops with longer periods than others of the device have requests of their own.
        """
        settings = self.devices[device]
        tags = self.maps.get(device, {})
        if not tags:
            return ()
        if settings.is_opcua:
            return plan_nodes(tags, self.loops_of(device).values(), settings.opcua.max_nodes)
        return plan_reads(
            tags.values(),
            settings.max_gap,
            settings.max_registers,
            settings.ranges,
            together=self.together(device),
            one_tag=settings.quirks.one_request_per_tag,
            polls=polls_by_tag(self.loops_of(device).values()),
        )

    def requests_of_loop(self, name: str) -> tuple[ReadRequest, ...]:
        """Return a read plan of one loop's own tags, all of them in every scan.

        For who acts on them: a mode of ten seconds ago would be another, and what is wrong with
        other loops of the device is no concern.
        """
        loop = self.loops[name]
        settings, known = self.devices[loop.device], self.maps.get(loop.device, {})
        return plan_reads(
            [replace(known[tag], every=0.0) for tag in dict.fromkeys(loop.tags)],
            settings.max_gap,
            settings.max_registers,
            settings.ranges,
            together=((loop.op, loop.pv), loop.tags),
            one_tag=settings.quirks.one_request_per_tag,
        )

    def poll_period(self, device: str) -> float:
        """Return the plant seconds between two polls of a device; see `polling`."""
        return poll_period(self.loops_of(device).values())

    def with_device(self, name: str, **changes: Any) -> Site:
        """Return the site with keys of one device changed, for instance its port.

        The changed device is validated; the rules between tables are not checked again.

        Raises:
            SiteError: the device cannot be like that.
        """
        device = self._changed(self.devices[name], changes, f"devices.{name}")
        return self._with(devices={**self.devices, name: device})

    def with_loop(self, name: str, **changes: Any) -> Site:
        """Return the site with keys of one loop changed; see `with_device`."""
        loop = self._changed(self.loops[name], changes, f"loops.{name}")
        return self._with(loops={**self.loops, name: loop})

    def with_data_dir(self, folder: Path) -> Site:
        """Return the site with another folder for what Fieldlink writes."""
        settings = self.file.site.model_copy(update={"data_dir": folder.absolute()})
        return self._with(site=settings)

    def _changed(self, model: M, changes: Mapping[str, object], key: str) -> M:
        try:
            return type(model).model_validate(dict(model) | dict(changes))
        except ValidationError as error:
            raise SiteError(
                Problem(
                    str(self.path),
                    ".".join([key, *map(str, detail["loc"])]),
                    f"cannot be {detail['input']!r}: {detail['msg']}",
                    "ask for another value",
                )
                for detail in error.errors()
            ) from error

    def _with(self, **parts: Any) -> Site:
        return replace(self, file=self.file.model_copy(update=parts))
