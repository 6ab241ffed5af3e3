"""One place where an error that a user can cause becomes a message and an exit status."""

from __future__ import annotations

import typer

__all__ = ["explain"]

_EXTRAS = {
    "asyncua": "opcua",
    "casadi": "nlp",
    "distributed": "dask",
    "fpdf": "plot",
    "matplotlib": "plot",
    "openpyxl": "excel",
    "paho": "mqtt",
    "psycopg": "postgresql",
    "pyarrow": "parquet",
}
"""Which extra of the package brings a library that not everybody needs."""


def explain(error: Exception) -> bool:
    """Print one of the project's own errors on stderr; say whether it was one.

    Anything else is a defect of ours, and its traceback is wanted.
    """
    from estimator import EstimatorError
    from fieldlink.errors import FieldlinkError
    from fieldlink.printable import as_printable
    from fmu_models import PlantError

    if isinstance(error, ModuleNotFoundError) and error.name in _EXTRAS:
        words = (
            f"this needs {error.name}, which is not installed; install it with "
            f"pip install 'fieldlink[{_EXTRAS[error.name]}]'"
        )
    elif isinstance(error, EstimatorError | FieldlinkError | PlantError):
        words = as_printable(str(error), lines=True)
    else:
        return False
    typer.secho(f"fieldlink: {words}", err=True, fg=typer.colors.RED)
    return True
