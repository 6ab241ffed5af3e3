"""The official JavaScript decoder of Sparkplug reads what we send, and we read what it encodes."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from fieldlink.upward.sparkplug_payload import DataType, Metric, Payload, decode, encode

NODE = Path(__file__).resolve().parents[1] / "interop" / "node"
SCRIPT = """
const spb = require("sparkplug-payload").get("spBv1.0");
const theirs = spb.decodePayload(Buffer.from(process.argv[1], "hex"));
const metrics = theirs.metrics.map((m) => [m.name ?? null, m.alias == null ? null : Number(m.alias),
    m.type ?? null, typeof m.value === "object" && m.value !== null ? Number(m.value) : m.value,
    Boolean(m.isHistorical)]);
const back = spb.encodePayload({ timestamp: 5, metrics: [
    { name: "Node Control/Rebirth", type: "Boolean", value: true, timestamp: 5 },
    { name: "Command/Withdraw", type: "String", value: "because", timestamp: 5 },
] });
console.log(JSON.stringify({ seq: Number(theirs.seq), metrics,
    back: Buffer.from(back).toString("hex") }));
"""


def test_both_read_each_other() -> None:
    if shutil.which("node") is None or not (NODE / "node_modules" / "sparkplug-payload").is_dir():
        pytest.skip("sparkplug-payload is not installed (npm install --prefix tests/interop/node)")
    now = 1_795_262_400_000
    ours = Payload(
        (
            Metric("Estimate/Verdict", 3, DataType.STRING, "stiction", now),
            Metric("Estimate/Stick Band", 4, DataType.DOUBLE, 2.5, now),
            Metric("Message/ID", 5, DataType.INT64, 2**40, now),
            Metric("Sample/Auto", 6, DataType.BOOLEAN, True, now),
            Metric("Sample/Quality", 7, DataType.INT32, 11, now, historical=True),
            Metric("Estimate/R2", 8, DataType.DOUBLE, None, now),
        ),
        now,
        200,
    )
    done = subprocess.run(
        ["node", "-e", SCRIPT, encode(ours).hex()],
        cwd=NODE,
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout)
    assert found["seq"] == 200
    assert found["metrics"] == [
        ["Estimate/Verdict", 3, "String", "stiction", False],
        ["Estimate/Stick Band", 4, "Double", 2.5, False],
        ["Message/ID", 5, "Int64", 2**40, False],
        ["Sample/Auto", 6, "Boolean", True, False],
        ["Sample/Quality", 7, "Int32", 11, True],
        ["Estimate/R2", 8, "Double", None, False],
    ]
    theirs = decode(bytes.fromhex(found["back"]))
    assert [(metric.name, metric.value) for metric in theirs.metrics] == [
        ("Node Control/Rebirth", True),
        ("Command/Withdraw", "because"),
    ]
