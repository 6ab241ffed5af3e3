"""Units: an FMU's own definitions, common ones, and what cannot be converted."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from fieldlink.lab.fmu import FmuError, conversion
from fmu_models import fmu_path, summarise

Minis = dict[str, Path]


@pytest.mark.parametrize(
    ("variable", "unit", "tag", "value"),
    [
        ("tank.h", "mm", 1500.0, 1.5),  # the FMU's display unit
        ("tank.h", "cm", 150.0, 1.5),  # a common one
        ("tank.h", "m", 1.5, 1.5),
        ("tank.h", None, 1.5, 1.5),
        ("tank.inflow[1]", "m3/h", 7200.0, 2.0),
        ("tank.inflow[1]", "l/min", 60000.0, 1.0),
    ],
)
def test_conversion(
    mini_fmus: Minis, variable: str, unit: str | None, tag: float, value: float
) -> None:
    change = conversion(summarise(mini_fmus["fmi2"]), variable, unit)
    assert change.to_variable(tag) == pytest.approx(value, rel=1e-12)
    assert change.to_tag(value) == pytest.approx(tag, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "tag", "kelvin_above_zero"), [("K", 373.15, 100.0), ("degF", 212.0, 100.0)]
)
def test_units_with_an_offset(unit: str, tag: float, kelvin_above_zero: float) -> None:
    change = conversion(summarise(fmu_path("heat")), "pv", unit)  # pv is in degC
    assert change.to_variable(tag) == pytest.approx(kelvin_above_zero, abs=1e-9)


@pytest.mark.parametrize(
    ("variable", "unit", "words"),
    [
        ("tank.h", "bar", "another quantity than 'bar'"),
        ("tank.h", "milimeter", "unit 'milimeter' of tank.h is not known"),
        ("pump.on", "m", "variable pump.on has no unit"),
    ],
)
def test_what_does_not_convert(mini_fmus: Minis, variable: str, unit: str, words: str) -> None:
    with pytest.raises(FmuError, match=words):
        conversion(summarise(mini_fmus["fmi2"]), variable, unit)


def altered(fmu: Path, folder: Path, old: bytes, new: bytes) -> Path:
    """The FMU with another text in its description."""
    file = folder / fmu.name
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(file, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            target.writestr(
                name, content.replace(old, new) if name == "modelDescription.xml" else content
            )
    return file


@pytest.mark.parametrize(("unit", "tag"), [("K", 10.0), ("degF", 18.0)])
def test_a_difference_converts_without_the_zero_point(
    tmp_path: Path, unit: str, tag: float
) -> None:
    file = altered(
        fmu_path("heat"), tmp_path, b'unit="degC"', b'unit="degC" relativeQuantity="true"'
    )
    change = conversion(summarise(file), "pv", unit)
    assert change.to_variable(tag) == pytest.approx(10.0)
    assert change.to_tag(10.0) == pytest.approx(tag)


def test_a_display_unit_by_division_is_no_factor(mini_fmus: Minis, tmp_path: Path) -> None:
    file = altered(
        mini_fmus["fmi2"], tmp_path, b'name="mm" factor', b'name="per_m" inverse="true" factor'
    )
    with pytest.raises(FmuError, match=r"unit 'per_m' of tank\.h is not known"):
        conversion(summarise(file), "tank.h", "per_m")
