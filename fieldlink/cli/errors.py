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


_ELSEWHERE = {"estimator.outcomes": "EstimatorError", "fmu_models.errors": "PlantError"}
"""Errors of packages that a command may do without, by the modules that define them."""


def explain(error: Exception) -> bool:
    """Print one of the project's own errors on stderr; say whether it was one.

    Anything else is a defect of the program, whose traceback must be seen.
    """
    from fieldlink.errors import FieldlinkError
    from fieldlink.printable import as_printable

    known: tuple[type[Exception], ...] = (FieldlinkError, *_loaded_errors())
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


def _loaded_errors() -> tuple[type[Exception], ...]:
    """Return the errors of those packages that are loaded.

    Without its package there can be no such error. To load one for that would take seconds of
    every refusal, and an edge box has no FMPy.
    """
    return tuple(
        getattr(sys.modules[module], name)
        for module, name in _ELSEWHERE.items()
        if module in sys.modules
    )
