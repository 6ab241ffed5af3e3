"""Compile the kernels of the loop families into the cache, as `fieldlink warm-up` does for others.

    python -m benchmarks.compile_families

`make dev` does it once. Workers of the tests that need them at the same time would all wait.
"""

from __future__ import annotations

from benchmarks.families import report, tuning

__all__ = ["compile_families", "main"]


def compile_families() -> None:
    """Draw a loop of every kind: between them they need nearly every kernel."""
    for kind in tuning.STICKY_KINDS:
        tuning.draw(kind, True, 1)
    for kind in tuning.HEALTHY_KINDS:
        tuning.draw(kind, False, 1)
    for name, kind in report.KINDS.items():
        if kind.sticky:
            report.draw(name, True, 1)
        if kind.healthy:
            report.draw(name, False, 1)


def main() -> None:
    """Compile them and say so."""
    compile_families()
    print("kernels of the loop families are compiled")


if __name__ == "__main__":
    main()
