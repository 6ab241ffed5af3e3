"""Every FMU of the zoo gives the samples that FMPy's own simulation gives."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.fmu_zoo import LIMITS, cases, difference


@pytest.mark.thorough
def test_every_fmu_of_the_zoo_agrees_with_fmpy(tmp_path: Path) -> None:
    compared = [(case, *difference(case)) for case in cases(tmp_path)]
    assert len(compared) >= 15  # those that need no other tool than a C compiler and pythonfmu
    for case, gap, columns in compared:
        assert columns >= 1
        assert gap <= LIMITS[case.kind], (case.name, case.kind, gap)
