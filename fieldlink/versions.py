"""What a report of a defect has to say about the installation: versions and platform."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

__all__ = ["REPORTED_PACKAGES", "find_versions"]

REPORTED_PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "pandas",
    "pymodbus",
    "fmpy",
    "sqlalchemy",
    "piqp",
    "casadi",
    "asyncua",
    "paho-mqtt",
    "pyarrow",
)
"""Packages whose version has an effect on a result, a link or the store; some are optional."""


def find_versions() -> dict[str, str]:
    """Return versions by name: fieldlink, Python, the platform, then each installed package."""
    found = {
        "fieldlink": _version("fieldlink") or "not installed as a package",
        "Python": f"{platform.python_version()} ({platform.python_implementation()})",
        "platform": platform.platform(),
    }
    for name in REPORTED_PACKAGES:
        if (installed := _version(name)) is not None:
            found[name] = installed
    return found


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
