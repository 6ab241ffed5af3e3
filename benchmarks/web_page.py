"""The pages on a large site: bytes and times with 500 loops and a year of daily estimates.

A store is filled as that site would fill it, `fieldlink web` serves it from a process of its own,
and each page is asked for over HTTP on loopback: the first view from a server that has just begun,
the others as the median of several. Bytes are those on the wire (packed), for the first view with
every file that it loads. With Chromium at hand, a browser draws a loop's trend with 10,000 points:
the time is that of the chart library's own drawing.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import httpx

from benchmarks.report import heading, keep, table
from benchmarks.web_store import fill_store
from fieldlink.web.responses import STATIC

LOOPS, DAYS = 500, 365
POINTS = 10_000
REPEATS = 5


DRAWING = """points => {
  const time = [], op = [], stem = [], found = [];
  for (let k = 0; k < points; k++) {
    time.push(1.7e9 + k);
    op.push(50 + 6 * Math.sin(k / 40));
    stem.push(Math.round(op[k]));
  }
  const series = [{}, { stroke: "#888" }, { stroke: "#d55e00" }];
  const options = { width: 1500, height: 230, legend: { show: false }, series };
  const plot = new uPlot(options, [time, op, stem], document.getElementById("course"));
  return new Promise((done) => {
    const again = (k) => {
      if (k === 20) {
        plot.destroy();
        return done(found.sort((a, b) => a - b)[10]);
      }
      const began = performance.now();
      plot.setData([time, op.map((value) => value + k), stem]);
      // The chart draws in a microtask of its own, which comes before this one.
      queueMicrotask(() => {
        found.push(performance.now() - began);
        setTimeout(() => again(k + 1), 0);
      });
    };
    again(0);
  });
}"""
"""Draws a trend twenty times with new values; the median in milliseconds."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Fill, serve, ask, print; with ``--out`` keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=LOOPS)
    parser.add_argument("--days", type=int, default=DAYS)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "history.sqlite"
        now_ms = round(time.time() * 1000.0)
        url = fill_store(
            file, now_ms=now_ms, loops=options.loops, days=options.days, long_samples=30_000
        )
        megabytes = file.stat().st_size / 1e6
        rows, figures = measure(url.removeprefix("sqlite:///"))
    text = "\n\n".join(
        (
            heading("web_page", __doc__, arguments),
            f"The store: {options.loops} loops, {options.days} days, {megabytes:.0f} MB.",
            table(("what", "kB on the wire", "kB unpacked", "seconds"), rows),
        )
    )
    print(text)
    if options.out is not None:
        keep(options.out, "web_page", text, {"rows": figures, "megabytes": megabytes})


def measure(file: str) -> tuple[list[tuple[Any, ...]], dict[str, Any]]:
    """Ask for everything; return rows of the table, and the same as a document."""
    rows: list[tuple[Any, ...]] = []
    with serving(file) as (address, begun):
        with httpx.Client(base_url=address, timeout=120.0) as client:
            began = time.perf_counter()
            wire, plain = ask(client, "/")
            first = time.perf_counter() - began
            for name in ("fieldlink.css", "fleet.js", "live.js"):
                more = ask(client, f"/static/{name}")
                wire, plain = wire + more[0], plain + more[1]
            rows.append(("first view of the fleet", wire / 1e3, plain / 1e3, first))
            hour = "/api/loops/LIC-0001/samples"
            for label, path in (
                ("fleet", "/"),
                ("what changed in the fleet", "/fragments/fleet?revision=999999"),
                ("fleet as JSON", "/api/loops"),
                ("loop", "/loops/LIC-0001"),
                ("devices", "/devices"),
                ("trend, one hour at 1 s", f"{hour}?last=3600&points=4000"),
                ("trend, eight hours at 1 s", f"{hour}?last=28800&points=4000"),
                (f"trend, {POINTS} points", f"{hour}?last=28800&points={POINTS}"),
            ):
                times = []
                for _ in range(REPEATS):
                    began = time.perf_counter()
                    wire, plain = ask(client, path)
                    times.append(time.perf_counter() - began)
                rows.append((label, wire / 1e3, plain / 1e3, statistics.median(times)))
            charts = sum(ask(client, f"/static/{name}")[0] for name in STATIC)
            rows.append(("all files of the pages, charts included", charts / 1e3, "", ""))
        drawn = draw(address)
        if drawn is not None:
            rows.append((f"a browser draws {POINTS} points of OP and stem", "", "", drawn))
        rows.append(("the server is ready to answer", "", "", begun))
    return rows, {label: [wire, plain, seconds] for label, wire, plain, seconds in rows}


def ask(client: httpx.Client, path: str) -> tuple[int, int]:
    """Return bytes on the wire and unpacked."""
    answer = client.get(path, headers={"Accept-Encoding": "gzip"})
    answer.raise_for_status()
    return answer.num_bytes_downloaded, len(answer.content)


class serving:  # noqa: N801  (reads as a statement)
    """`fieldlink web` on a file, in a process of its own: its address, and the seconds it took."""

    def __init__(self, file: str) -> None:
        self._file = file

    def __enter__(self) -> tuple[str, float]:
        began = time.perf_counter()
        command = [sys.executable, "-m", "fieldlink.cli", "web", self._file, "--port", "0"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        address = self._process.stdout.readline().split()[-1]
        return address, time.perf_counter() - began

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.communicate()


def draw(address: str) -> float | None:
    """Seconds in which a browser draws a chart again; None without a browser."""
    chromium = shutil.which("chromium")
    if chromium is None:
        return None
    from playwright.sync_api import sync_playwright

    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1600, "height": 900})
        page.goto(f"{address}loops/LIC-0001")
        page.locator("#trend-op canvas").wait_for()
        milliseconds = page.evaluate(DRAWING, POINTS)
        browser.close()
    return float(milliseconds) / 1000.0


if __name__ == "__main__":
    main()
