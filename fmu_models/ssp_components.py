"""Take the FMUs of a system out of its archive."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

from .errors import PlantFileError

__all__ = ["extract_components"]


def extract_components(file: Path, sources: Mapping[str, str], folder: Path) -> dict[str, Path]:
    """Extract the FMU of every component of an SSP archive; return their paths by component.

    Raises:
        PlantFileError: one of them is not in the archive.
    """
    found: dict[str, Path] = {}
    with zipfile.ZipFile(file) as archive:
        for number, (component, source) in enumerate(sources.items()):
            target = folder / f"{number}" / Path(source).name
            target.parent.mkdir()
            try:
                target.write_bytes(archive.read(source))
            except KeyError as error:
                raise PlantFileError(
                    f"{file}: {component}: its FMU {source} is not in the archive"
                ) from error
            found[component] = target
    return found
