"""One place where an error that a user can cause becomes a message and an exit status."""

from __future__ import annotations

import sys

import typer

__all__ = ["explain"]

LAB_PACKAGES = ("fmpy", "lxml")
"""What the extra ``lab`` installs; an edge box does without."""


def explain(error: Exception) -> bool:
    """Print one of the project's own errors on stderr; say whether it was one.

    Anything else is a defect of ours, and its traceback is wanted.
    """
    from estimator import EstimatorError
    from fieldlink.errors import FieldlinkError
    from fieldlink.printable import as_printable

    # An edge box has no FMPy, and without it there can be no error of a plant.
    plants = sys.modules.get("fmu_models.errors")
    known = (EstimatorError, FieldlinkError, *((plants.PlantError,) if plants else ()))
    if isinstance(error, ModuleNotFoundError) and _package(error) in LAB_PACKAGES:
        said = f"simulated plants need {_package(error)}: pip install 'fieldlink[lab]'"
    elif isinstance(error, known):
        said = str(error)
    else:
        return False
    typer.secho(f"fieldlink: {as_printable(said, lines=True)}", err=True, fg=typer.colors.RED)
    return True


def _package(error: ModuleNotFoundError) -> str:
    return (error.name or "").split(".")[0]
