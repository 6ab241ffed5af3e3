"""One place where an error that a user can cause becomes a message and an exit status."""

from __future__ import annotations

import sys

import typer

__all__ = ["explain"]

_EXTRAS = {
    "asyncua": "opcua",
    "casadi": "nlp",
    "distributed": "dask",
    "fmpy": "lab",
    "fpdf": "plot",
    "lxml": "lab",
    "matplotlib": "plot",
    "openpyxl": "excel",
    "paho": "mqtt",
    "psycopg": "postgresql",
    "pyarrow": "parquet",
}
"""Which extra of the package brings a library that not every user needs."""


def explain(error: Exception) -> bool:
    """Print one of the project's own errors on stderr; say whether it was one.

    Anything else is a defect of the program, whose traceback must be seen.
    """
    from estimator import EstimatorError
    from fieldlink.errors import FieldlinkError
    from fieldlink.printable import as_printable

    # An edge box has no FMPy, and without it there can be no error of a plant.
    plants = sys.modules.get("fmu_models.errors")
    known = (EstimatorError, FieldlinkError, *((plants.PlantError,) if plants else ()))
    missing = (error.name or "").split(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if missing in _EXTRAS:
        words = (
            f"this command needs {missing}, which is not installed; install it with "
            f"pip install 'fieldlink[{_EXTRAS[missing]}]'"
        )
    elif isinstance(error, known):
        words = as_printable(str(error), lines=True)
    else:
        return False
    typer.secho(f"fieldlink: {words}", err=True, fg=typer.colors.RED)
    return True
