"""One place where an error that a user can cause becomes a message and an exit status."""

from __future__ import annotations

import typer

__all__ = ["explain"]


def explain(error: Exception) -> bool:
    """Print one of the project's own errors on stderr; say whether it was one.

    Anything else is a defect of ours, and its traceback is wanted.
    """
    from estimator import EstimatorError
    from fieldlink.errors import FieldlinkError
    from fieldlink.printable import as_printable
    from fmu_models import PlantError

    if not isinstance(error, EstimatorError | FieldlinkError | PlantError):
        return False
    typer.secho(f"fieldlink: {as_printable(str(error), lines=True)}", err=True, fg=typer.colors.RED)
    return True
