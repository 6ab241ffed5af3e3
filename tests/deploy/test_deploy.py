"""What is shipped for systemd, Prometheus and Grafana fits what the daemon says and takes."""

from __future__ import annotations

import configparser
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families

from fieldlink.cli.app import app
from fieldlink.cli.run import TRY_AGAIN
from fieldlink.daemon import (
    DaemonStatus,
    DeviceStatus,
    Estimate,
    EstimateOutcome,
    Findings,
    Interval,
    LoopStatus,
    WritebackOutcome,
)
from fieldlink.daemon.installation import InUseError
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.links import LinkState
from fieldlink.site import SiteError
from fieldlink.store import StoreError, StoreReport
from fieldlink.store.errors import StoreAddressError, StoreMismatchError
from fieldlink.web import render_metrics

DEPLOY = Path(__file__).parents[2] / "deploy"
ALERTS = yaml.safe_load((DEPLOY / "prometheus" / "alerts.yml").read_text())
DASHBOARD = json.loads((DEPLOY / "grafana" / "fieldlink.json").read_text())

RULES = [rule for group in ALERTS["groups"] for rule in group["rules"]]
EXPRESSIONS = {f"alert {rule['alert']}": rule["expr"] for rule in RULES} | {
    f"panel {panel['title']}: {number}": target["expr"]
    for panel in DASHBOARD["panels"]
    for number, target in enumerate(panel["targets"])
}
SELECTOR = re.compile(r"\b((?:fieldlink|process)_\w+|up)\b(?:\{([^}]*)\})?")
MATCHER = re.compile(r'(\w+)(=~|!~|!=|=)"([^"]*)"')


def everything() -> DaemonStatus:
    """A status in which every metric has a sample."""
    interval = Interval(7.0, 6.9, 7.1)
    findings = Findings(
        "stiction", (), 9.0, interval, interval, interval, interval, 0.9, 0.9, "oe", 800, 0.1,
        None, {},
    )  # fmt: skip
    loop = LoopStatus(
        device="plc",
        counts=LoopCounts(5, 3, 1, 1, 1),
        filled=0.5,
        samples_until_estimate=3,
        latest=None,
        estimates=1,
        last_estimate=Estimate("FC101", 0, 9, 0.0, EstimateOutcome.ESTIMATED, findings=findings),
        attempts=1,
        last_attempt=None,
        last_accepted=None,
        outcomes={outcome.code: 1 for outcome in WritebackOutcome},
    )
    device = DeviceStatus(LinkState.GOOD, 1, 0, 1, 0, "", 1.0)
    return DaemonStatus({"plc": device}, {"FC101": loop}, StoreReport())


@pytest.fixture(scope="module")
def known() -> dict[str, dict[str, set[str]]]:
    """The names of all samples, with the values of each of their labels."""
    found: dict[str, dict[str, set[str]]] = {"up": {"job": {"fieldlink"}}}
    for family in text_string_to_metric_families(render_metrics(everything()).decode()):
        for sample in family.samples:
            labels = found.setdefault(sample.name, {"job": {"fieldlink"}})
            for label, value in sample.labels.items():
                labels.setdefault(label, set()).add(value)
    return found


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_every_expression_is_about_metrics_that_exist(
    name: str, known: dict[str, dict[str, set[str]]]
) -> None:
    selectors = SELECTOR.findall(EXPRESSIONS[name])
    assert selectors
    for metric, matchers in selectors:
        assert metric in known, metric
        for label, operator, value in MATCHER.findall(matchers):
            assert label in known[metric], f"{metric} has no label {label}"
            if operator == "=":
                assert value in known[metric][label], f"{metric} is never {label}={value}"
            elif value != "$loop":
                assert set(value.split("|")) <= known[metric][label]


def test_a_slip_of_the_pen_would_be_found(known: dict[str, dict[str, set[str]]]) -> None:
    assert "fieldlink_loop_slot_total" not in known
    assert "miss" not in known["fieldlink_loop_slots_total"]["outcome"]


def test_every_metric_of_importance_is_on_the_dashboard_or_in_an_alert(
    known: dict[str, dict[str, set[str]]],
) -> None:
    used = {metric for text in EXPRESSIONS.values() for metric, _ in SELECTOR.findall(text)}
    ours = {name for name in known if name.startswith("fieldlink_")}
    derived = {name for name in ours if name.endswith(("_count", "_sum", "_created"))}
    elsewhere = {
        "fieldlink_loop_estimates_total", "fieldlink_device_polls_total",
        "fieldlink_estimator_workers",
    }  # fmt: skip
    assert ours - derived - used == elsewhere


def test_every_alert_says_what_to_do() -> None:
    assert len({rule["alert"] for rule in RULES}) == len(RULES)
    for rule in RULES:
        assert set(rule) <= {"alert", "expr", "for", "labels", "annotations"}
        assert rule["labels"]["severity"] in ("critical", "warning", "info")
        assert set(rule["annotations"]) == {"summary", "action"}


def test_prometheus_itself_agrees() -> None:
    if (tool := shutil.which("promtool")) is None:
        pytest.skip("promtool is not here: apt-get install prometheus")
    for kind, name in (("rules", "alerts.yml"), ("config", "scrape.yml")):
        command = [tool, "check", kind, str(DEPLOY / "prometheus" / name)]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout + result.stderr


def test_the_dashboard_is_well_formed() -> None:
    panels: list[dict[str, Any]] = DASHBOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    cells = [
        (panel["gridPos"]["x"] + dx, panel["gridPos"]["y"] + dy)
        for panel in panels
        for dx in range(panel["gridPos"]["w"])
        for dy in range(panel["gridPos"]["h"])
    ]
    assert len(cells) == len(set(cells)), "panels overlap"
    assert max(x for x, _ in cells) < 24


def unit() -> configparser.RawConfigParser:
    parser = configparser.RawConfigParser(strict=False)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(DEPLOY / "systemd" / "fieldlink@.service")
    return parser


def test_the_service_waits_for_the_daemons_own_word() -> None:
    service = unit()["Service"]
    assert (service["Type"], service["NotifyAccess"]) == ("notify", "main")
    assert int(service["WatchdogSec"]) >= 30
    assert service["ExecReload"] == "/bin/kill -HUP $MAINPID"
    assert service["ExecStart"].split()[1:] == ["run", "/etc/fieldlink/%i/site.toml"]
    # The daemon takes five seconds for its tasks and twenty for the store.
    assert int(service["TimeoutStopSec"]) > 25


def test_the_service_waits_for_what_comes_up_later_and_not_for_a_wrong_site_file() -> None:
    """After a power cut a database server may need longer than any number of starts lasts."""
    parsed = unit()
    assert (parsed["Service"]["Restart"], parsed["Unit"]["StartLimitIntervalSec"]) == (
        "on-failure", "0"
    )  # fmt: skip
    ends = set(parsed["Service"]["RestartPreventExitStatus"].split())
    assert ends == {"2"}
    assert str(TRY_AGAIN) not in ends
    later, never = (StoreError, InUseError), (SiteError, StoreAddressError, StoreMismatchError)
    assert [kind.may_pass for kind in (*later, *never)] == [True, True, False, False, False]


def test_the_service_can_open_serial_ports() -> None:
    service = unit()["Service"]
    assert service["SupplementaryGroups"] == "dialout"
    assert service["PrivateDevices"] == "no"
    assert "DeviceAllow" not in service


def test_the_kernels_are_compiled_where_the_service_may_write() -> None:
    """systemd makes the cache directory of a bare machine, before anything of the unit runs."""
    service = unit()["Service"]
    # %C is /var/cache for a system's unit (systemd.unit(5)).
    cache = f"%C/{service['CacheDirectory']}"
    # Reports with pictures: matplotlib would warn of a home that is read-only, at every start.
    assert service["Environment"].split() == [
        f"NUMBA_CACHE_DIR={cache}", f"MPLCONFIGDIR={cache}/matplotlib"
    ]  # fmt: skip
    program, command = service["ExecStartPre"].split()
    assert (program, command) == ("/opt/fieldlink/bin/fieldlink", "warm-up")
    assert command in {name.name for name in app.registered_commands}
