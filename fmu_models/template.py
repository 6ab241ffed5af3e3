"""Begin a model of one's own: a C file that builds and runs, with what to fill in."""

from __future__ import annotations

import re
from pathlib import Path

from .errors import PlantBuildError

__all__ = ["new_model"]

_TEMPLATE = Path(__file__).with_name("templates") / "model.c"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")


def new_model(name: str, folder: Path) -> Path:
    """Write ``name.c`` into ``folder`` and return its path.

    Args:
        name: of the model: a C name in small letters.
        folder: is made where it is missing.

    Raises:
        PlantBuildError: not such a name, the file is there already, or it cannot be written.
    """
    if not _NAME.fullmatch(name):
        raise PlantBuildError(
            f"{name!r} cannot be the name of a model; use small letters, digits and underscores, "
            "a letter first, for instance my_tank"
        )
    file = folder / f"{name}.c"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = _TEMPLATE.read_text(encoding="utf-8").replace("NAME", name)
        stream = file.open("x", encoding="utf-8")
        try:
            with stream:
                stream.write(text)
        except OSError:
            # Half a file would be in the way of the next attempt.
            file.unlink(missing_ok=True)
            raise
    except FileExistsError as error:
        raise PlantBuildError(f"{file}: it is there already; choose another name") from error
    except OSError as error:
        raise PlantBuildError(
            f"{file}: it cannot be written ({error.strerror or error})"
        ) from error
    return file
