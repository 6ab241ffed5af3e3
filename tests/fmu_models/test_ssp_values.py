"""Systems of FMUs (SSP 1.0): units, transformations and start values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_models import PlantFileError, PlantInputError, open_plant, summarise
from tests.fmu_models.ssp_files import (
    NAMESPACES,
    OWN,
    Minis,
    binding,
    bound,
    component,
    connection,
    connector,
    entry,
    table,
    tank,
    write,
)


def test_units_transformations_and_parameters(mini_fmus: Minis, tmp_path: Path) -> None:
    """The level in m goes on in mm, times -0.002 plus 3; modes come inline, by file and mapped."""
    values = (
        '<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="{}">'
        '<ssv:Real value="{}"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
    )
    inline = f"<ssd:ParameterValues>{values.format('mode', 2)}</ssd:ParameterValues>"
    on_first = (
        f"<ssd:ParameterBindings><ssd:ParameterBinding>{inline}</ssd:ParameterBinding>"
        "</ssd:ParameterBindings>"
    )
    by_file = (
        '<ssd:ParameterBindings><ssd:ParameterBinding source="resources/p.ssv">'
        '<ssd:ParameterMapping source="resources/p.ssm"/></ssd:ParameterBinding>'
        "</ssd:ParameterBindings>"
    )
    extra = {
        "resources/p.ssv": values.format("speed", 1).replace(
            "<ssv:ParameterSet", f"<ssv:ParameterSet{NAMESPACES}"
        ),
        "resources/p.ssm": f'<ssm:ParameterMapping{NAMESPACES} version="1.0"><ssm:MappingEntry '
        'source="speed" target="second.mode"><ssc:LinearTransformation factor="2" offset="0"/>'
        "</ssm:MappingEntry></ssm:ParameterMapping>",
    }
    change = '<ssc:LinearTransformation factor="-0.002" offset="3"/>'
    between = connection("first/tank.h", "second/tank.inflow[1]", change)
    file = write(
        tmp_path / "units.ssp",
        mini_fmus["fmi2"],
        tank("first", more=on_first) + tank("second", "mm"),
        connection("feed", "first/tank.inflow[1]") + between + connection("second/tank.h", "level"),
        own=OWN, bindings=by_file, extra=extra,
    )  # fmt: skip
    with open_plant(file, period=0.5, parameters={"feed": 1.0}) as plant:
        table = plant.run(60, {})
    # At rest: h1 = 2 x 1 m, h2 = 2 x (-0.002 x 2000 + 3)
    np.testing.assert_allclose(table["first.tank.h"][-1], 2.0, rtol=1e-6)
    np.testing.assert_allclose(table["second.tank.h"][-1], -2.0, rtol=1e-6)


def test_start_values_by_the_rules_of_the_schema(mini_fmus: Minis, tmp_path: Path) -> None:
    """Outer systems win, later bindings win, prefixes come before mappings, unknown names go."""
    outside = bound(
        binding(
            'first.gauge=<ssv:Integer value="7"/>',
            'first.speed=<ssv:Enumeration value="quick"/>',
            'nobody.knows=<ssv:Real value="1"/>',
            'level=<ssv:Real value="9"/>',
            mapping=entry("first.gauge", "second.mode", table("Integer", ("7", "2"), ("8", "1")))
            + entry("first.speed", "first.mode", table("Enumeration", ("quick", "fast"))),
        ),
        binding('mode=<ssv:Real value="1"/>', attributes=' prefix="nobody."'),
    )
    slow = binding('mode=<ssv:Enumeration value="slow"/>')
    inflow = binding('tank.inflow[1]=<ssv:Real value="250" unit="mm"/>')
    file = write(
        tmp_path / "starts.ssp", mini_fmus["fmi2"],
        tank("first", "m", more=bound(slow, inflow)) + tank("second", more=bound(slow)),
        connection("second/tank.h", "level"), own=connector("level", "output", "m"),
        bindings=outside,
    )  # fmt: skip
    summary = summarise(file)
    starts = {v.name: v.start for v in summary.variables}
    assert (starts["first.mode"], starts["second.mode"]) == ("2", "2")
    assert starts["first.tank.inflow[1]"] == "0.25"  # its connector is in m
    assert any("nobody.mode" in text for text in summary.warnings)
    with open_plant(file, period=0.5, isolated=False) as plant:
        end = plant.run(60, {})
    np.testing.assert_allclose(end["first.tank.h"][-1], 0.5, rtol=1e-6)


def test_tables_and_enumerations_of_connections(mini_fmus: Minis, tmp_path: Path) -> None:
    """A mode of the system in words feeds the tanks' modes; one that is not in the table fails."""
    choice = (
        '<ssd:Connector name="choice" kind="input"><ssc:Enumeration name="Own"/></ssd:Connector>'
    )
    mode = '<ssd:Connector name="mode" kind="input"><ssc:Enumeration name="Mode"/></ssd:Connector>'
    enumerations = (
        '<ssd:Enumerations><ssc:Enumeration name="Own"><ssc:Item name="slow" value="10"/>'
        '<ssc:Item name="fast" value="20"/></ssc:Enumeration><ssc:Enumeration name="Mode">'
        '<ssc:Item name="single" value="1"/><ssc:Item name="double" value="2"/>'
        "</ssc:Enumeration></ssd:Enumerations>"
    )
    words = table("Enumeration", ("slow", "single"), ("fast", "double"))
    inflow, level = connector("tank.inflow[1]", "input"), connector("tank.h", "output", "m")
    file = write(
        tmp_path / "tables.ssp", mini_fmus["fmi2"], component("first", inflow, level, mode),
        connection("feed", "first/tank.inflow[1]") + connection("first/tank.h", "level")
        + connection("choice", "first/mode", words),
        own=OWN + choice, enumerations=enumerations,
    )  # fmt: skip
    assert next(v.start for v in summarise(file).variables if v.name == "choice") == "10"
    with open_plant(file, period=0.5, parameters={"feed": 1.0}, isolated=False) as plant:
        table_ = plant.run(60, {"choice": 20.0})
        np.testing.assert_allclose(table_["level"][-1], 2.0, rtol=1e-6)
        with pytest.raises(PlantInputError, match="has no entry for 3, only for 10, 20"):
            plant.step({"choice": 3.0})


LABEL = '<ssd:Connector name="label" kind="parameter"><ssc:String/></ssd:Connector>'


def text_of(name: str, text: str) -> str:
    return f'{name}=<ssv:String value="{text}"/>'


def labelled(file: Path, fmu: Path, *parameters: str, more: str = "") -> Path:
    """Two tanks with a label; that of the second is a parameter of the system."""
    batch = connector("batch", "output")
    inflow = connector("tank.inflow[1]", "input")
    elements = component("first", LABEL, batch, inflow) + component("second", LABEL, batch)
    links = connection("label", "second/label") + more
    given = bound(binding(*parameters)) if parameters else ""
    return write(file, fmu, elements, links, own=LABEL, bindings=given)


def test_texts_of_parameter_sets(mini_fmus: Minis, tmp_path: Path) -> None:
    fmu, file = mini_fmus["fmi2"], tmp_path / "texts.ssp"
    labelled(file, fmu, text_of("first.label", "abc"), text_of("label", "de"))
    starts = {v.name: v.start for v in summarise(file).variables}
    assert starts["first.label"] == "abc"
    own: dict[str, float | str] = {"label": "vwxyz", "first.label": ""}
    for given, batches in (({}, (3.0, 2.0)), (own, (0.0, 5.0))):
        with open_plant(file, period=0.5, parameters=given) as plant:
            found = plant.step({})
            assert (found["first.batch"], found["second.batch"]) == batches


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        ('first.label=<ssv:Real value="3"/>', r"first\.label: it takes text; the file gives 3"),
        (text_of("first.mode", "fast"), r"first\.mode: it takes a number; the file gives the text"),
        ('x=<ssv:Binary value="00"/>', "parameter x is binary data, which cannot be set; leave it"),
    ],
)
def test_values_that_do_not_fit_their_variables(
    mini_fmus: Minis, tmp_path: Path, parameter: str, words: str
) -> None:
    file = labelled(tmp_path / "wrong.ssp", mini_fmus["fmi2"], parameter)
    with pytest.raises(PlantFileError, match=words):
        open_plant(file, period=0.5)


def test_what_is_no_number_does_not_pass_between_fmus(odd: Minis, tmp_path: Path) -> None:
    blob = connector("blob", "output")
    elements = component("first", blob) + component("second", connector("u", "input"))
    ways = (connection("first/blob", "blob"), connection("first/blob", "second/u"))
    files = [
        write(tmp_path / f"{k}.ssp", odd["plain"], elements, way, own=blob)
        for k, way in enumerate(ways)
    ]
    assert "outputs left out, they are not numbers: blob" in summarise(files[0]).warnings
    with open_plant(files[0], parameters={"first.names[1]": "a", "first.names[2]": ""}) as plant:
        assert plant.step({})["first.count"] == 1.0
    with pytest.raises(PlantFileError, match=r"u is fed by first\.blob, a variable of the type B"):
        open_plant(files[1])
