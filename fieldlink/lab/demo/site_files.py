"""The site of a demonstration: written as files, so that its user can read it and run it again."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np

from fieldlink.errors import FieldlinkError
from fieldlink.site import Site, load_site, read_recording
from fmu_models import catalogue
from loop_model import ValveModel

__all__ = ["DEVICE", "PORT", "DemoError", "Scene", "recorded_scene", "simulated_scene"]

DEVICE = "plc"

PORT = 502
"""The port that Modbus has by its standard, for a site file before the simulated PLC has one."""

PLANT = "example1"
SPEED = 40.0
WINDOW = 600
SETPOINT = ((0.0, 50.0), (10.0, 54.0), (300.0, 52.0))
"""The first step starts the limit cycle: at rest the unaware controller may never leave the band.
The second one falls into the window: without one J cannot be separated from the process gain."""

REPLAY_SECONDS = 18.0
REPLAYED_SHARE = 0.85
"""Rows that make the window; the rest passes before the daemon is connected and while it works."""

OLDEST = 600.0
"""Wall seconds for which an estimate may wait to be written: as long as a demonstration may take.
The plant does not change meanwhile; a busy machine needs many windows' time for an estimate."""


class DemoError(FieldlinkError):
    """The demonstration cannot be set up or did not come to its end."""


@dataclass(frozen=True, slots=True)
class Scene:
    """What a demonstration runs on.

    Attributes:
        folder: where its files are.
        loop: the loop's name.
        valve: the plant's true valve; None for a recording, whose stem is unknown.
        recording: the replayed file, None for a simulated plant.
        window: samples of the window.
    """

    folder: Path
    loop: str
    valve: ValveModel | None
    recording: Path | None
    window: int
    _values: dict[str, str]

    @property
    def file(self) -> Path:
        """The site file."""
        return self.folder / "site.toml"

    def write(self, port: int) -> Site:
        """Write the site for a PLC on ``port`` and load it.

        Raises:
            DemoError: the folder cannot be written.
        """
        values = self._values | {"port": str(port), "file": self.file.name}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for name in ("registers.csv", "site.toml"):
                template = Template((files(__package__) / "templates" / name).read_text("utf-8"))
                (self.folder / name).write_text(template.substitute(values), "utf-8")
        except OSError as error:
            raise DemoError(
                f"{self.folder}: the demonstration's files cannot be written "
                f"({error.strerror or error}); name a writable folder with --output"
            ) from error
        return load_site(self.file)


def simulated_scene(folder: Path, *, seed: int, speed: float = SPEED) -> Scene:
    """Return the paper's Example 1: an unaware MPC on a sticky valve."""
    model = catalogue[PLANT]
    steps = ", ".join(f"[{at}, {value}]" for at, value in SETPOINT)
    plant = (
        f'fmu = "{PLANT}"\ncontroller = "mpc"\ncompensate = true\nseed = {seed}\n'
        f"setpoint = [{steps}]\nparameters = {{ op_start = {SETPOINT[0][1]} }}"
    )
    low, high = model.op_range
    values = _values("FC101", speed, model.period, WINDOW, WINDOW / 4, 0.25 * (high - low), plant)
    return Scene(folder, "FC101", model.valve, None, WINDOW, values)


def recorded_scene(folder: Path, recording: Path) -> Scene:
    """Return a loop that replays a recording.

    Raises:
        RecordingError: the file is not a recording of a loop.
        DemoError: OP of the recording is constant.
    """
    recorded = read_recording(recording)
    rows = len(recorded)
    span = float(np.nanmax(recorded.op) - np.nanmin(recorded.op))
    if not span > 0.0:
        raise DemoError(
            f"{recording}: OP does not change in it, so there is no valve movement to identify; "
            "choose a recording in which OP moves"
        )
    loop = re.sub(r"[^A-Za-z0-9_]", "_", recording.stem) or "LOOP"
    window = max(50, int(rows * REPLAYED_SHARE))
    speed = max(1.0, rows * recorded.period / REPLAY_SECONDS)
    plant = f"recording = '{recording.resolve()}'\ncontroller = \"none\""
    values = _values(loop, speed, recorded.period, window, window / 4, span, plant)
    return Scene(folder, loop, None, recording, window, values)


def _values(
    loop: str,
    speed: float,
    period: float,
    window: int,
    estimate_samples: float,
    limit: float,
    plant: str,
) -> dict[str, str]:
    """The template's values; ``limit`` bounds the S and J that may be written."""
    return {
        "loop": loop,
        "speed": f"{speed:.6g}",
        "period": repr(period),
        "window": str(window),
        "estimate_every": repr(math.ceil(estimate_samples) * period),
        "max_age": f"{OLDEST * speed:.6g}",
        "limit": f"{limit:.6g}",
        "deadband": f"{0.005 * limit:.6g}",
        "plant": plant,
        # A folder of its own for every run: a history holds one course of the loop's slots.
        "data_dir": f"data-{datetime.now(UTC):%Y%m%dT%H%M%S%f}",
    }
