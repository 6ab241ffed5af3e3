"""Systems of FMUs (SSP 1.0): how components, systems and signal dictionaries hang together."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmu_models import PlantFileError, open_plant, summarise
from tests.fmu_models.ssp_files import (
    CHAIN,
    NAMESPACES,
    OWN,
    Minis,
    connection,
    connector,
    tank,
    write,
)


@pytest.mark.parametrize("isolated", [True, False])
def test_two_tanks_in_a_row_are_the_two_tanks_by_hand(
    mini_fmus: Minis, tmp_path: Path, isolated: bool
) -> None:
    file = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    feed = 1.0 + np.sin(np.arange(40) / 4.0)
    with open_plant(file, period=0.1, isolated=isolated) as plant:
        assert plant.info.inputs == ("feed",)
        table = plant.run(40, {"feed": feed})
    level = []
    with (
        open_plant(mini_fmus["fmi2"], period=0.1, isolated=False) as first,
        open_plant(mini_fmus["fmi2"], period=0.1, isolated=False) as second,
    ):
        for value in feed:
            between = first.step({"tank.inflow[1]": value})["tank.h"]
            level.append(second.step({"tank.inflow[1]": between})["tank.h"])
    np.testing.assert_array_equal(table["level"], level)
    np.testing.assert_array_equal(table["second.tank.h"], level)


def test_systems_inside_systems_are_flattened(mini_fmus: Minis, tmp_path: Path) -> None:
    inner = (
        '<ssd:System name="inner"><ssd:Connectors>'
        + connector("in", "input") + connector("out", "output")
        + f"</ssd:Connectors><ssd:Elements>{tank('second')}</ssd:Elements><ssd:Connections>"
        + connection("in", "second/tank.inflow[1]") + connection("second/tank.h", "out")
        + "</ssd:Connections></ssd:System>"
    )  # fmt: skip
    links = (
        connection("feed", "first/tank.inflow[1]")
        + connection("first/tank.h", "inner/in")
        + connection("level", "inner/out")  # from sink to source: the direction follows the kinds
    )
    nested = write(
        tmp_path / "nested.ssp", mini_fmus["fmi2"], inner + tank("first"), links, own=OWN
    )
    flat = write(
        tmp_path / "flat.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    tables = []
    for file in (nested, flat):
        with open_plant(file, period=0.2, isolated=False) as plant:
            tables.append(plant.run(20, {"feed": 2.0}))
    np.testing.assert_array_equal(tables[0]["level"], tables[1]["level"])
    assert "inner.second.tank.h" in tables[0]


@pytest.mark.parametrize("beside", [True, False])
def test_signal_dictionaries_are_wires_with_names(
    mini_fmus: Minis, tmp_path: Path, beside: bool
) -> None:
    """The bus carries the level in mm from the outer system to a tank in the inner one, in m."""
    space = "http://ssp-standard.org/SSP1/SystemStructureSignalDictionary"
    bus = (
        f'<ssb:SignalDictionary xmlns:ssb="{space}"{NAMESPACES} version="1.0">'
        '<ssb:DictionaryEntry name="h"><ssc:Real unit="mm"/></ssb:DictionaryEntry>'
        "</ssb:SignalDictionary>"
    )
    source = ' source="bus.ssb"' if beside else ""
    declared = (
        f'<ssd:SignalDictionaries><ssd:SignalDictionary name="bus"{source}>'
        f"{'' if beside else bus}</ssd:SignalDictionary></ssd:SignalDictionaries>"
    )

    def reference(name: str, kind: str, entry: str = "h", to: str = "bus") -> str:
        return (
            f'<ssd:SignalDictionaryReference name="{name}" dictionary="{to}"><ssd:Connectors>'
            f"{connector(entry, kind)}</ssd:Connectors></ssd:SignalDictionaryReference>"
        )

    def system(outer: str, entry: str = "h", more: str = "") -> Path:
        inner = (
            f'<ssd:System name="inner"><ssd:Connectors>{connector("level", "output", "m")}'
            f"</ssd:Connectors><ssd:Elements>{reference('tap', 'output')}{tank('second', 'm')}"
            f"</ssd:Elements><ssd:Connections>{connection('tap/h', 'second/tank.inflow[1]')}"
            f"{connection('second/tank.h', 'level')}</ssd:Connections></ssd:System>"
        )
        file = write(
            tmp_path / f"{len(list(tmp_path.iterdir()))}.ssp", mini_fmus["fmi2"],
            tank("first") + inner + outer,
            connection("feed", "first/tank.inflow[1]") + connection("inner/level", "level")
            + connection(f"tap/{entry}", "first/tank.h") + more,
            own=OWN, extra={"bus.ssb": bus},
        )  # fmt: skip
        with zipfile.ZipFile(file) as archive:
            content = {name: archive.read(name) for name in archive.namelist()}
        text = content["SystemStructure.ssd"].decode()
        place = text.rindex("</ssd:System>")
        content["SystemStructure.ssd"] = (text[:place] + declared + text[place:]).encode()
        with zipfile.ZipFile(file, "w") as archive:
            for name, part in content.items():
                archive.writestr(name, part)
        return file

    plain = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    levels = []
    for file in (system(reference("tap", "inout")), plain):
        with open_plant(file, period=0.1, parameters={"feed": 2.0}, isolated=False) as plant:
            levels.append(plant.run(10, {})["level"])
    np.testing.assert_allclose(levels[0], levels[1], rtol=1e-12)
    for file, words in (
        (system(reference("tap", "input", "x"), "x"), "has no entry 'x', it has h"),
        (system(reference("tap", "input", to="bux")), "there is no signal dictionary 'bux'"),
        (
            system(reference("tap", "input"), more=connection("tap/h", "inner/level")),
            "h is connected twice",
        ),
    ):
        with pytest.raises(PlantFileError, match=words):
            summarise(file)


@pytest.mark.parametrize(
    ("elements", "connections", "words"),
    [
        (tank("first") * 2, "", "first: two elements have this name; rename one"),
        ("", "", "it has no component"),
        (tank("first"), connection("second/tank.h", "level"), "an element 'second', there is none"),
    ],
)
def test_structures_that_make_no_system(
    mini_fmus: Minis, tmp_path: Path, elements: str, connections: str, words: str
) -> None:
    """Lists that a tool writes empty are not a fault."""
    file = write(tmp_path / "x.ssp", mini_fmus["fmi2"], elements, connections, own=OWN)
    with pytest.raises(PlantFileError, match=words):
        summarise(file)


@pytest.mark.parametrize(
    ("connections", "unit", "words"),
    [
        (connection("feed", "first/nothing"), "", "names a connector 'nothing', there is none"),
        (connection("feed", "level"), "", "level"),
        (CHAIN + connection("feed", "second/tank.inflow[1]"), "", "is connected twice"),
        (CHAIN, "s", "are different quantities"),
        (CHAIN, "ft", "define both units"),
    ],
)
def test_systems_that_do_not_fit(
    mini_fmus: Minis, tmp_path: Path, connections: str, unit: str, words: str
) -> None:
    elements = tank("first") + tank("second", unit)
    file = write(tmp_path / "bad.ssp", mini_fmus["fmi2"], elements, connections, own=OWN)
    if words == "level":  # an input of the system that goes straight to an output is fine
        with open_plant(file, period=0.5, parameters={"feed": 3.0}) as plant:
            assert plant.outputs()["level"] == 3.0
        return
    with pytest.raises(PlantFileError, match=words):
        open_plant(file, period=0.5)


def test_files_that_are_no_systems(tmp_path: Path, mini_fmus: Minis) -> None:
    text = tmp_path / "text.ssp"
    text.write_text("hello")
    with pytest.raises(PlantFileError, match="it is not an SSP archive"):
        open_plant(text)
    elements = tank("first") + tank("second").replace("tank.fmu", "no.fmu")
    missing = write(tmp_path / "missing.ssp", mini_fmus["fmi2"], elements, CHAIN, own=OWN)
    with pytest.raises(PlantFileError, match=r"its FMU resources/no\.fmu is not in the archive"):
        open_plant(missing, period=1.0)
