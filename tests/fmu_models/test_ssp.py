"""Systems of FMUs (SSP 1.0): connections, units, parameters, and the same loop as one FMU."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fmu_models import (
    Master,
    PlantEndedError,
    PlantFileError,
    PlantInputError,
    PlantNameError,
    open_plant,
    summarise,
)
from fmu_models.example_system import build_example_system

Minis = dict[str, Path]

_NAMES = "".join(
    f' xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{long}"'
    for short, long in (
        ("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"),
        ("ssm", "ParameterMapping"),
    )
)  # fmt: skip
UNITS = """<ssd:Units>
<ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>
<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit>
<ssc:Unit name="s"><ssc:BaseUnit s="1"/></ssc:Unit></ssd:Units>"""


def connector(name: str, kind: str, unit: str = "") -> str:
    mark = f' unit="{unit}"' if unit else ""
    return f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real{mark}/></ssd:Connector>'


def component(name: str, *connectors: str, more: str = "") -> str:
    return (
        f'<ssd:Component name="{name}" source="resources/tank.fmu">'
        f"<ssd:Connectors>{''.join(connectors)}</ssd:Connectors>{more}</ssd:Component>"
    )


def tank(name: str, unit: str = "", more: str = "") -> str:
    inflow = connector("tank.inflow[1]", "input", unit)
    return component(name, inflow, connector("tank.h", "output", "m"), more=more)


def connection(start: str, end: str, more: str = "") -> str:
    ends = []
    for side, text in (("start", start), ("end", end)):
        element, _, name = text.rpartition("/")
        ends.append(f'{side}Element="{element}" ' if element else "")
        ends.append(f'{side}Connector="{name}" ')
    return f"<ssd:Connection {''.join(ends)}>{more}</ssd:Connection>"


def write(
    file: Path, fmu: Path, elements: str, connections: str, *, own: str = "",
    bindings: str = "", extra: dict[str, str] | None = None, enumerations: str = "",
) -> Path:  # fmt: skip
    text = (
        f'<ssd:SystemStructureDescription name="two" version="1.0"{_NAMES}>'
        f'<ssd:System name="two"><ssd:Connectors>{own}</ssd:Connectors>{bindings}'
        f"<ssd:Elements>{elements}</ssd:Elements>"
        f"<ssd:Connections>{connections}</ssd:Connections></ssd:System>{enumerations}{UNITS}"
        '<ssd:DefaultExperiment startTime="0" stopTime="4"/></ssd:SystemStructureDescription>'
    )
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        archive.write(fmu, "resources/tank.fmu")
        for name, content in (extra or {}).items():
            archive.writestr(name, content)
    return file


OWN = connector("feed", "input") + connector("level", "output", "m")
CHAIN = (
    connection("feed", "first/tank.inflow[1]")
    + connection("first/tank.h", "second/tank.inflow[1]")
    + connection("second/tank.h", "level")
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
            "<ssv:ParameterSet", f"<ssv:ParameterSet{_NAMES}"
        ),
        "resources/p.ssm": f'<ssm:ParameterMapping{_NAMES} version="1.0"><ssm:MappingEntry '
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
        f'<ssb:SignalDictionary xmlns:ssb="{space}"{_NAMES} version="1.0">'
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
    """Lists that a tool writes empty are no fault."""
    file = write(tmp_path / "x.ssp", mini_fmus["fmi2"], elements, connections, own=OWN)
    with pytest.raises(PlantFileError, match=words):
        summarise(file)


def test_info_and_run_take_a_system(mini_fmus: Minis, tmp_path: Path) -> None:
    file = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    summary = summarise(file)
    assert (summary.fmi_version, summary.stop_time) == ("SSP 1.0", 4.0)
    assert "one step goes through first, then second (Gauss-Seidel)" in summary.warnings
    assert CliRunner().invoke(app, ["info", str(file)]).exit_code == 0
    out = tmp_path / "out.csv"
    done = CliRunner().invoke(
        app,
        ["run", str(file), "--step", "0.25", "--set", "feed=2", "--set", "first.mode=2",
         "--watch", "first.der(tank.h)", "--out", str(out)],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    table = pd.read_csv(out)
    assert len(table) == 17
    np.testing.assert_allclose(table["first.tank.h"] + table["first.der(tank.h)"], 4.0, atol=1e-6)


def test_a_component_that_ends_or_is_unknown(mini_fmus: Minis, tmp_path: Path) -> None:
    file = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    with open_plant(file, period=0.5) as plant:
        kept = []
        faults = np.array([0.0, 0.0, 5.0])
        with pytest.raises(PlantEndedError, match="system two: plant mini: the FMU ended"):
            kept.extend(plant.run_pieces(3, {"second.fault": faults}))
        assert sum(piece.time.size for piece in kept) == 2
    with pytest.raises(PlantNameError, match=r"no component of 'third\.mode'"):
        open_plant(file, period=0.5, parameters={"third.mode": 1.0})


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


def values(*parameters: str) -> str:
    inside = "".join(
        f'<ssv:Parameter name="{name}">{value}</ssv:Parameter>'
        for name, _, value in (text.partition("=") for text in parameters)
    )
    return (
        f'<ssv:ParameterSet{_NAMES} version="1.0" name="p"><ssv:Parameters>{inside}'
        "</ssv:Parameters></ssv:ParameterSet>"
    )


def binding(*parameters: str, mapping: str = "", attributes: str = "") -> str:
    inside = f"<ssd:ParameterValues>{values(*parameters)}</ssd:ParameterValues>"
    if mapping:
        inside += (
            f'<ssd:ParameterMapping><ssm:ParameterMapping{_NAMES} version="1.0">{mapping}'
            "</ssm:ParameterMapping></ssd:ParameterMapping>"
        )
    return f"<ssd:ParameterBinding{attributes}>{inside}</ssd:ParameterBinding>"


def bound(*bindings: str) -> str:
    return f"<ssd:ParameterBindings>{''.join(bindings)}</ssd:ParameterBindings>"


def entry(source: str, target: str, change: str) -> str:
    return f'<ssm:MappingEntry source="{source}" target="{target}">{change}</ssm:MappingEntry>'


def table(kind: str, *pairs: tuple[str, str]) -> str:
    entries = "".join(f'<ssc:MapEntry source="{a}" target="{b}"/>' for a, b in pairs)
    return f"<ssc:{kind}MappingTransformation>{entries}</ssc:{kind}MappingTransformation>"


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


def test_jacobi_gives_everybody_the_values_of_the_step_before(
    mini_fmus: Minis, tmp_path: Path
) -> None:
    file = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    tables = [
        _run(file, master, isolated)
        for master, isolated in (("jacobi", True), ("jacobi", False), ("gauss-seidel", False))
    ]
    np.testing.assert_array_equal(tables[0]["level"], tables[1]["level"])
    np.testing.assert_array_equal(tables[0]["first.tank.h"], tables[2]["first.tank.h"])
    # The second tank is fed one step later, so its whole answer is.
    np.testing.assert_allclose(tables[0]["level"][1:], tables[2]["level"][:-1], atol=1e-12)
    with pytest.raises(PlantInputError, match="a master is for systems"):
        open_plant(mini_fmus["fmi2"], master="jacobi")


def _run(file: Path, master: Master, isolated: bool) -> dict[str, np.ndarray]:
    with open_plant(file, period=0.1, isolated=isolated, master=master) as plant:
        return plant.run(20, {"feed": 2.0})


def test_a_run_is_exported_as_a_system_that_repeats_it(mini_fmus: Minis, tmp_path: Path) -> None:
    system = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    for source, given in ((system, ["feed=2", "first.mode=fast"]), (mini_fmus["fmi2"], ["mode=2"])):
        exported, again = tmp_path / "run.ssp", tmp_path / "again.csv"
        options = [text for pair in given for text in ("--set", pair)]
        first = ["run", str(source), "--step", "0.25", "--stop", "3", "--in-process", *options]
        if source is system:
            first += ["--master", "jacobi"]
        done = CliRunner().invoke(app, [*first, "--export", str(exported)])
        assert done.exit_code == 0, done.output
        with zipfile.ZipFile(exported) as archive:
            kept = pd.read_csv(archive.open("extra/fieldlink/run.csv"))
        done = CliRunner().invoke(app, ["run", str(exported), "--in-process", "--out", str(again)])
        assert done.exit_code == 0, done.output
        repeated = pd.read_csv(again)
        pd.testing.assert_frame_equal(repeated[kept.columns], kept, check_exact=True)


def test_the_shipped_example_is_the_loop_in_one_fmu(tmp_path: Path) -> None:
    file = build_example_system(tmp_path)
    with open_plant(file) as plant:
        assert plant.info.period == 1.0
        system = plant.run(300, {"sp": 50.0})
    whole = {"controller": 1.0, "op_start": 40.0, "noise_std": 0.0}
    with open_plant("example1", parameters=whole) as plant:
        one = plant.run(300, {})
    for ours, theirs in (("op", "op_out"), ("pv", "pv"), ("stem", "stem")):
        np.testing.assert_allclose(system[ours], one[theirs], rtol=1e-12)
    assert np.ptp(one["stem"]) > 5.0
