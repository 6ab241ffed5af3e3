"""The alerts fire: Prometheus itself judges each condition; its rules of matching are kept."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families

from fieldlink.web import render_metrics
from tests.deploy.test_deploy import DEPLOY, EXPRESSIONS, MATCHER, RULES, SELECTOR, everything

SERIES = {
    "FieldlinkDown": {"up": "0x99"},
    "FieldlinkDeviceDemoted": {'fieldlink_device_state{state="demoted"}': "1x99"},
    "FieldlinkDeviceDegraded": {'fieldlink_device_state{state="degraded"}': "1x99"},
    "FieldlinkTagsQuarantined": {"fieldlink_device_quarantined_tags": "2x99"},
    "FieldlinkSamplesMissed": {
        'fieldlink_loop_slots_total{outcome="missed"}': "0+3x99",
        'fieldlink_loop_slots_total{outcome="expected"}': "0+60x99",
    },
    "FieldlinkSamplesBad": {
        'fieldlink_loop_slots_total{outcome="bad"}': "0+30x99",
        'fieldlink_loop_slots_total{outcome="expected"}': "0+60x99",
    },
    "FieldlinkLoopSilent": {"fieldlink_loop_seconds_since_sample": "0+60x99"},
    "FieldlinkRepliesLate": {
        'fieldlink_reply_lateness_seconds_bucket{le="0.5"}': "0+1x99",
        'fieldlink_reply_lateness_seconds_bucket{le="1.0"}': "0+9x99",
        'fieldlink_reply_lateness_seconds_bucket{le="+Inf"}': "0+9x99",
    },
    "FieldlinkStoreFailing": {"fieldlink_store_failing": "1x99"},
    "FieldlinkRecordsLost": {"fieldlink_store_lost_total": "0x80 5x19"},
    "FieldlinkStoreSetAside": {"fieldlink_store_set_aside_total": "0x80 1x19"},
    "FieldlinkStoreGone": {"fieldlink_store_gone_total": "0x80 1x19"},
    "FieldlinkEstimatorRestarts": {"fieldlink_estimator_rebuilt_total": "0+1x99"},
    "FieldlinkEstimatorBehind": {"fieldlink_estimator_waiting": "9x99"},
    "FieldlinkClockStepped": {"fieldlink_clock_steps_total": "0x80 1x19"},
    "FieldlinkDefect": {"fieldlink_defects_total": "0x80 1x19"},
    "FieldlinkSiteRefused": {'fieldlink_site_reloads_total{result="refused"}': "0x80 1x19"},
    "FieldlinkBlockNotTaken": {
        'fieldlink_loop_writebacks_total{outcome="write_failed"}': "0x80 1x19"
    },
    "ValveSticks": {'fieldlink_loop_verdict{verdict="stiction"}': "1x1500"},
}
"""For each alert, series of one value a minute that call for it."""


def labelled(series: str) -> str:
    """Give a series the labels that Prometheus and the daemon add."""
    name, _, own = series.partition("{")
    added = 'job="fieldlink",instance="box",loop="FC101",device="plc"'
    return f"{name}{{{added}}}" if not own else f"{name}{{{added},{own}"


def test_each_alert_fires_in_prometheus(tmp_path: Path) -> None:
    assert set(SERIES) == {rule["alert"] for rule in RULES}
    if (tool := shutil.which("promtool")) is None:
        pytest.skip("promtool is not here: apt-get install prometheus")
    tests = []
    for name, series in SERIES.items():
        rule = next(rule for rule in RULES if rule["alert"] == name)
        at = "1500m" if rule.get("for") == "1d" else "95m"
        given = [{"series": labelled(one), "values": value} for one, value in series.items()]
        # Wrong on purpose: what promtool finds instead is what fired.
        wanted = [{"eval_time": at, "alertname": name, "exp_alerts": []}]
        tests.append({"interval": "1m", "input_series": given, "alert_rule_test": wanted})
    file = tmp_path / "tests.yml"
    rules = str(DEPLOY / "prometheus" / "alerts.yml")
    file.write_text(yaml.safe_dump({"rule_files": [rules], "tests": tests}))
    said = subprocess.run(
        [tool, "test", "rules", str(file)], capture_output=True, text=True, check=False
    )
    fired = set(re.findall(r'alertname="(\w+)"', said.stdout + said.stderr))
    assert fired == set(SERIES), said.stdout + said.stderr


def test_two_sides_of_a_comparison_match() -> None:
    """Series match by all of their labels (Prometheus manual, vector matching).

    A label that is told on each side, differently, has to be left out of the matching.
    """
    for name, text in EXPRESSIONS.items():
        told: dict[str, set[str]] = {}
        for _, matchers in SELECTOR.findall(text):
            for label, operator, value in MATCHER.findall(matchers):
                if operator == "=":
                    told.setdefault(label, set()).add(value)
        for label, values in told.items():
            if len(values) > 1 and "sum(" not in text:
                assert f"ignoring({label})" in text, name


def test_what_is_counted_begins_at_zero() -> None:
    """``increase`` is blind for a count that is there only once it is 1 (Prometheus manual)."""
    status = everything()
    loop = replace(status.loops["FC101"], outcomes={}, attempts=0, may_write=True)
    begun = replace(status, loops={"FC101": loop})
    known = {
        (sample.name, label, value)
        for family in text_string_to_metric_families(render_metrics(begun).decode())
        for sample in family.samples
        for label, value in sample.labels.items()
    }
    for rule in RULES:
        for metric, matchers in SELECTOR.findall(rule["expr"]):
            if f"increase({metric}" not in rule["expr"]:
                continue
            for label, _, values in MATCHER.findall(matchers):
                for value in values.split("|"):
                    assert (metric, label, value) in known, rule["alert"]
