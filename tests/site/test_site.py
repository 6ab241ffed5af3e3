from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pydantic
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fieldlink.registers import ExchangeLayout
from fieldlink.site import (
    Problem,
    SiteError,
    check,
    load_site,
    read_recording,
    read_register_map,
    schema,
)
from fieldlink.site.toml_source import TomlSource

SHIPPED = sorted((Path(__file__).parents[2] / "site_configs").glob("*.toml"))
DEMO = Path(__file__).parents[2] / "site_configs" / "demo.toml"


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_site_is_sound(path: Path) -> None:
    report = check(load_site(path))
    assert report.warnings == ()
    assert all(loop.op_pv_together for loop in report.loops)
    json.dumps(report.to_dict())


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_table_of_a_shipped_site_refuses_unknown_keys(path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "site"
    shutil.copytree(path.parent, folder)
    lines = path.read_text(encoding="utf-8").splitlines()
    headers = [number for number, line in enumerate(lines) if line.startswith("[")]
    assert headers
    for number in headers:
        changed = [*lines[: number + 1], "surprise = 1", *lines[number + 1 :]]
        (folder / path.name).write_text("\n".join(changed), encoding="utf-8")
        with pytest.raises(SiteError) as caught:
            load_site(folder / path.name)
        place = "surprise" if "parameters" in lines[number] else "surprise: unknown key"
        assert place in str(caught.value)
        assert f"{path.name}:{number + 2}:" in str(caught.value)


def test_the_shipped_recording_is_whole() -> None:
    recording = read_recording(DEMO.parent / "FC202.csv")
    assert (len(recording), recording.period, recording.nan_runs) == (900, 2.0, ())


def test_the_demo_in_the_names_of_the_program() -> None:
    site = load_site(str(DEMO))
    assert site.name == "demo"
    assert site.data_dir == DEMO.parent / "data"
    assert site.historian_url == f"sqlite:///{DEMO.parent}/data/history.sqlite"
    loop = site.loops["FC101"]
    assert loop.tags == ("FC101.OP", "FC101.PV", "FC101.SP", "FC101.MODE", "FC101.SCAN")
    assert loop.writeback.exchange == ExchangeLayout.at(100)
    pv = site.tag("FC101", "pv")
    assert pv is not None
    assert (pv.address, pv.count, pv.unit) == (2, 2, "%")
    (request,) = site.requests("plc")
    assert (request.address, request.count) == (0, 8)


def test_a_site_is_frozen() -> None:
    site = load_site(DEMO)
    with pytest.raises(pydantic.ValidationError):
        site.loops["FC101"].period = 2.0
    with pytest.raises(AttributeError):
        site.path = DEMO  # type: ignore[misc]


def test_changes_make_another_site_and_are_validated() -> None:
    site = load_site(DEMO)
    other = site.with_device("plc", port=15020).with_loop("FC101", window=400)
    assert (other.devices["plc"].port, other.loops["FC101"].window) == (15020, 400)
    assert (site.devices["plc"].port, site.loops["FC101"].window) == (5020, 800)
    with pytest.raises(SiteError, match=r"devices\.plc\.port: cannot be 0: .*greater"):
        site.with_device("plc", port=0)


def test_the_data_folder_can_be_elsewhere(tmp_path: Path) -> None:
    site = load_site(DEMO).with_data_dir(tmp_path)
    assert site.historian_url == f"sqlite:///{tmp_path}/history.sqlite"


def test_a_folder_whose_name_means_something_in_an_address_holds_the_historian(
    tmp_path: Path,
) -> None:
    from fieldlink.store.database import file_of

    for name in ("100%20plant", "what?now"):
        site = load_site(DEMO).with_data_dir(tmp_path / name)
        assert file_of(site.historian_url) == tmp_path / name / "history.sqlite"


@pytest.mark.parametrize(
    "url", ["sqlite:////var/lib/history.sqlite", "sqlite:///:memory:", "postgresql://db/history"]
)
def test_other_historian_urls_stay_as_they_are(url: str, tmp_path: Path) -> None:
    shutil.copytree(DEMO.parent, tmp_path / "site")
    path = tmp_path / "site" / "demo.toml"
    path.write_text(DEMO.read_text(encoding="utf-8") + f'\n[historian]\nurl = "{url}"\n')
    assert load_site(path).historian_url == url


def test_the_order_of_a_device_is_that_of_its_tags() -> None:
    tags = read_register_map(DEMO.parent / "two_loops.csv", word_order="little")
    assert tags["FC201.PV"].decode([0x0000, 0x3F80]).value == 1.0
    assert tags["FC202.OP"].decode([3987]).value == pytest.approx(39.87)


def test_the_schema_knows_every_key_with_its_meaning() -> None:
    found = schema()
    assert set(found["properties"]) == {
        "site", "devices", "loops", "historian", "estimation", "web", "report", "mqtt", "findings",
        "notify", "opcua_server",
    }  # fmt: skip
    assert found["additionalProperties"] is False
    for name, table in found["$defs"].items():
        assert table["additionalProperties"] is False
        for key, value in table["properties"].items():
            assert value.get("description"), f"{name}.{key} has no description"


def test_the_schema_agrees_with_the_loader_on_the_shipped_sites() -> None:
    def unknown(data: dict[str, Any], part: dict[str, Any]) -> list[str]:
        part = next((option for option in part.get("anyOf", ()) if "$ref" in option), part)
        if "$ref" in part:
            part = schema()["$defs"][part["$ref"].rsplit("/", 1)[1]]
        extra = part.get("additionalProperties")
        wrong = []
        for key, value in data.items():
            inner = part.get("properties", {}).get(key, extra)
            if not inner:
                wrong.append(key)
            elif isinstance(value, dict):
                wrong += unknown(value, inner)
        return wrong

    for path in SHIPPED:
        assert unknown(TomlSource(path).data, schema()) == []


@pytest.mark.parametrize(
    ("key", "line"),
    [
        (("site",), 1),
        (("site", "name"), 2),
        (("loops", "FC 1"), 4),
        (("loops", "FC 1", "pi", "gain"), 5),
        (("loops", "FC 1", "setpoint", 1, 0), 6),
        (("loops", "FC 1", "plant", "seed"), 10),
        (("loops", "FC 1", "missing"), 4),
        (("devices",), None),
        (("loops", 'the "new" é.1', "period"), 12),
    ],
)
def test_lines_of_keys(key: tuple[str | int, ...], line: int | None, tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text(
        "[site]\n"
        'name = "x"\n'
        "\n"
        '[ loops . "FC 1" ] # a name with a blank\n'
        "pi.gain = 2\n"
        "setpoint = [\n"
        "  [0, 1],\n"
        "  [5, 2],\n"
        "]\n"
        "plant.seed = 1\n"
        '[loops."the \\"new\\" \\u00e9.1"]\n'
        '"per\\u0069od" = 1\n',
        encoding="utf-8",
    )
    assert TomlSource(path).line_of(key) == line


def test_a_missing_site_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SiteError, match=r"none\.toml: cannot be read \(No such file"):
        load_site(tmp_path / "none.toml")
    with pytest.raises(SiteError, match="cannot be read"):
        load_site(tmp_path)


def test_a_site_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes(b'[site]\nname = "Gr\xf6\xdfe"\n')
    with pytest.raises(SiteError, match="is not UTF-8 text"):
        load_site(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[a.b]\n[a.b]\n", ":2: is not TOML: [a.b] is there already; join the two tables"),
        ("[a]\nb = { c = 1 }\n[a.b]\n", ":3: is not TOML: [a.b] is there already; join"),
        ("enabled = yes\n", ":1: is not TOML: Invalid value; texts stand in straight"),
        ("host = 192.168.1.10\n", "one key a line; texts stand in"),
        ('map = "C:\\maps"\n', "write / or \\\\ in its place"),
    ],
)
def test_slips_against_toml_have_a_remedy(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_text(text)
    with pytest.raises(SiteError, match=re.escape(said)):
        load_site(tmp_path / "site.toml")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)


def paths(data: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of every key and list item inside ``data``."""
    inner = dict(enumerate(data)) if isinstance(data, list) else data
    if not isinstance(inner, dict):
        return [at]
    return [at] * bool(at) + [path for key in inner for path in paths(inner[key], (*at, key))]


def to_toml(value: Any) -> str:
    """TOML's values are JSON's, apart from null and the writing of tables."""
    if isinstance(value, dict):
        inner = ", ".join(f"{json.dumps(k)} = {to_toml(v)}" for k, v in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(to_toml, value))}]"
    return json.dumps(value) if value is not None else '"null"'


@pytest.fixture
def spoilt(tmp_path: Path) -> Callable[[tuple[Any, ...], Any], Path]:
    shutil.copytree(DEMO.parent, tmp_path / "site")

    def spoil(at: tuple[Any, ...], value: Any) -> Path:
        data = TomlSource(DEMO).data
        inner = data
        for key in at[:-1]:
            inner = inner[key]
        inner[at[-1]] = value
        text = "\n".join(f"{json.dumps(key)} = {to_toml(value)}" for key, value in data.items())
        path = tmp_path / "site" / "spoilt.toml"
        path.write_text(text, encoding="utf-8", errors="replace")
        return path

    return spoil


def problems_of(path: Path) -> tuple[Problem, ...]:
    """Return what is wrong with a site file; a sound one must be one that `check` can explain."""
    try:
        site = load_site(path)
    except SiteError as error:
        return error.problems
    assert check(site).loops
    return ()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(at=st.sampled_from(paths(TomlSource(DEMO).data)), value=JSON)
def test_a_site_with_any_one_value_changed_loads_or_is_explained(
    at: tuple[Any, ...], value: Any, spoilt: Callable[[tuple[Any, ...], Any], Path]
) -> None:
    path = spoilt(at, value)
    problems = problems_of(path)
    assert all(problem.message and problem.remedy for problem in problems)
