"""What must hold between a loop's plant and the rest of a site."""

from __future__ import annotations

from collections.abc import Iterator

from fieldlink.file_at import why_no_file
from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem, RecordingError, nearest
from fieldlink.site.models import Loop
from fieldlink.site.plant import PlantSettings
from fieldlink.site.recording import read_recording
from fieldlink.site.toml_source import TomlSource

__all__ = ["plant_fits"]


def plant_fits(site: Site, source: TomlSource, name: str, loop: Loop) -> Iterator[Problem]:
    """Return what is wrong with a loop's plant, seen together with the rest of the site."""
    device = site.devices.get(loop.device)
    plant = loop.plant
    if device is not None and device.link == "fmu" and plant is None:
        yield source.problem(
            ("loops", name), f"device {loop.device!r} is simulated", "add a table plant with an fmu"
        )
    if (
        device is not None
        and device.link == "recording"
        and (plant is None or plant.recording is None)
    ):
        yield source.problem(
            ("loops", name),
            f"device {loop.device!r} replays recordings",
            'add a table plant with recording = "FILE.csv"',
        )
    if plant is None:
        return
    yield from _shared_fits(site, source, name, loop, plant)
    yield from _external_fits(site, source, name, loop, plant)
    if plant.fmu is not None and plant.fmu.endswith((".fmu", ".ssp")):
        path = site.resolve(plant.fmu)
        if why := why_no_file(path):
            key = ("loops", name, "plant", "fmu")
            yield source.problem(key, f"there is no file {path} ({why})", "correct the path")
    if plant.recording is not None:
        key = ("loops", name, "plant", "recording")
        try:
            read_recording(site.resolve(plant.recording), period=loop.period)
        except RecordingError as error:
            remedy = "see what is wrong with it below"
            yield source.problem(key, f"{plant.recording} cannot be replayed", remedy)
            yield from error.problems
    if plant.compensate and loop.writeback.exchange is None:
        yield source.problem(
            ("loops", name, "plant", "compensate"),
            "there is no exchange area through which a block could come",
            f"give [loops.{name}.writeback] a base and a loop_id",
        )


def _shared_fits(
    site: Site, source: TomlSource, name: str, loop: Loop, plant: PlantSettings
) -> Iterator[Problem]:
    """A loop that is another part of an FMU runs with that FMU, in the same PLC."""
    if plant.of is None:
        return
    key = ("loops", name, "plant", "of")
    owner = site.loops.get(plant.of)
    if owner is None:
        yield source.problem(key, f"no loop is named {plant.of!r}", nearest(plant.of, site.loops))
    elif owner.plant is None or owner.plant.fmu is None:
        yield source.problem(
            key, f"loop {plant.of!r} has no FMU", "name the loop whose plant has the key fmu"
        )
    elif owner.device != loop.device:
        yield source.problem(
            key,
            f"loop {plant.of!r} is on device {owner.device!r}, this one on {loop.device!r}",
            "loops of one FMU must be on one device",
        )
    elif owner.period != loop.period:
        yield source.problem(
            key,
            f"loop {plant.of!r} has a period of {owner.period:g} s, this one {loop.period:g} s",
            "one FMU is stepped for all its loops at once: give them one period",
        )


def _external_fits(
    site: Site, source: TomlSource, name: str, loop: Loop, plant: PlantSettings
) -> Iterator[Problem]:
    """A client that controls must be able to write OP, and the status needs a tag."""
    if plant.controller_kind != "external":
        return
    tags = site.maps.get(loop.device, {})
    op = tags.get(loop.op)
    if op is not None and not op.writable:
        yield source.problem(
            ("loops", name, "plant", "controller"),
            f"a controller outside writes OP, and {loop.op} is not writable in the register map",
            "set writable to yes in the row of that tag",
        )
    status = plant.time_out.status
    if status is not None and status not in tags:
        yield source.problem(
            ("loops", name, "plant", "external", "status"),
            f"the register map has no tag {status!r}",
            nearest(status, tags),
        )
