"""Pictures of the pages, from a live run of the demonstration and from a store of 40 loops.

PLC, daemon and compensator run as in `fieldlink demo --hold`, at half its speed: twice the time for
a poll on a machine that draws pictures meanwhile. A browser opens the pages as a user would. The
picture of the report is that of `fieldlink demo` itself.
"""

from __future__ import annotations

import argparse
import logging
import math
import multiprocessing
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from benchmarks.web_page import serving
from benchmarks.web_store import fill_store
from fieldlink.daemon import configure_logging
from fieldlink.lab.demo.running import perform
from fieldlink.lab.demo.site_files import simulated_scene

LOOPS, DAYS = 40, 200
LIMIT = 8.0
"""Stick band, in units of OP, that the site of the picture allows."""
SPEED = 20.0
"""Times the speed of a plant with a sample a second."""
SAMPLES_AFTER = 600
"""Samples after the take-over in the picture of the loop: about as many as before it."""
FADED_MS = 5000.0
"""Until the colour of rows that have changed is gone."""
NEWEST_SAMPLE = 'parseInt(document.getElementById("trend-note").textContent)'
PATIENCE_MS = 240_000.0
WIDE = {"width": 1500, "height": 860}
PHONE = {"width": 390, "height": 844}


def main(arguments: Sequence[str] | None = None) -> None:
    """Take every picture into ``--images``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=Path, required=True)
    images = parser.parse_args(arguments).images
    images.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
        browser = running.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        of_the_demo(browser, Path(folder) / "slow", images)
        of_the_report(Path(folder) / "demo", images)
        file = Path(folder) / "history.sqlite"
        fill_store(file, now_ms=round(time.time() * 1000.0), loops=LOOPS, days=DAYS)
        with serving(str(site_of_the_store(file))) as (address, _):
            of_a_fleet(browser, address, images)
        browser.close()


def site_of_the_store(file: Path) -> Path:
    """Write a site whose historian is this file: its limits make bars and days to the limit."""
    names = [f"LIC-{number:04d}" for number in range(1, LOOPS + 1)]
    tags = [f"{name}.{role}" for name in names for role in ("OP", "PV")]
    rows = [f"{tag},{2 * number},float32" for number, tag in enumerate(tags)]
    file.with_name("map.csv").write_text("\n".join(["tag,address,type", *rows]) + "\n", "utf-8")
    loops = "".join(
        f"""
[loops.{name}]
device = "plc"
op = "{name}.OP"
pv = "{name}.PV"
period = 1.0
writeback = {{ limits = {{ stick_band = [0.5, {LIMIT}], slip_jump = [0.0, {LIMIT}] }} }}
"""
        for name in names
    )
    site = file.with_name("site.toml")
    site.write_text(
        f"""[site]
name = "mill"

[historian]
url = "sqlite:///{file}"

[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"
{loops}""",
        "utf-8",
    )
    return site


def play(folder: Path, pages: Connection) -> None:
    """Run the demonstration until it is ended; send its address, and a word when it is done."""
    configure_logging(logging.ERROR)
    scene = simulated_scene(folder, seed=1, speed=SPEED)
    perform(
        scene,
        lambda _: None,
        hold=math.inf,
        opened=pages.send,
        finished=lambda _: pages.send("done"),
    )


def of_the_demo(browser: Any, folder: Path, images: Path) -> None:
    """Pictures of one loop from its sick valve to the end of its oscillation."""
    spawn = multiprocessing.get_context("spawn")
    theirs, ours = spawn.Pipe()
    demo = spawn.Process(target=play, args=(folder, ours))
    demo.start()
    ours.close()
    try:
        address = theirs.recv()
        page = browser.new_page(viewport=WIDE)
        page.set_default_timeout(PATIENCE_MS)
        page.goto(address)
        page.locator("#fleet tr", has_text="compensated").wait_for()
        page.set_viewport_size({"width": 1500, "height": 350})
        page.wait_for_timeout(FADED_MS)
        page.screenshot(path=images / "web-demo.png")
        page.locator("#fleet th a").first.click()
        page.locator("[data-range='3600']").click()
        page.locator("#trend-note", has_text="samples").wait_for()
        taken_over = page.evaluate(NEWEST_SAMPLE)
        page.locator("#map").scroll_into_view_if_needed()
        page.locator("#map-note", has_text="dark").wait_for()
        wait_until(page, f"{NEWEST_SAMPLE} > {taken_over + SAMPLES_AFTER}")
        page.evaluate("scrollTo(0, 0)")
        page.set_viewport_size({"width": 1500, "height": 880})
        page.wait_for_timeout(1500)
        page.screenshot(path=images / "web-loop.png")
        # A picture ends where the window ends: all of the page has to be in it.
        page.set_viewport_size({"width": 1500, "height": 3600})
        page.wait_for_timeout(1500)
        clip = page.evaluate(
            """() => {
              const top = document.querySelector(".columns").getBoundingClientRect();
              const end = document.querySelector("[data-part=written]").getBoundingClientRect();
              return { x: 0, y: top.top - 10, width: 1500, height: end.bottom - top.top + 20 };
            }"""
        )
        page.screenshot(path=images / "web-why.png", clip=clip)
        page.goto(f"{address}devices")
        page.set_viewport_size({"width": 1500, "height": 720})
        page.locator("#link", has_text="live ").wait_for()
        page.screenshot(path=images / "web-devices.png")
        # Before that it would not end by itself.
        theirs.recv()
    finally:
        demo.terminate()
        demo.join()


def wait_until(page: Any, condition: str) -> None:
    """Wait for a condition on the page, whose policy lets no test poll inside it."""
    end = time.monotonic() + PATIENCE_MS / 1000.0
    while not page.evaluate(condition):
        if time.monotonic() > end:
            raise TimeoutError(f"the page never came to: {condition}")
        page.wait_for_timeout(250)


def of_the_report(folder: Path, images: Path) -> None:
    """The picture of the demonstration's own report."""
    command = [sys.executable, "-m", "fieldlink.cli", "demo", "--json", "--output", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    shutil.copyfile(folder / "run.png", images / "demo.png")


def of_a_fleet(browser: Any, address: str, images: Path) -> None:
    """Pictures of many loops, wide and on a phone."""
    page = browser.new_page(viewport=WIDE)
    page.goto(address)
    page.locator("#link", has_text="live ").wait_for()
    # The trends of the eight sticky loops come from a process apart.
    wait_until(
        page,
        """[...document.querySelectorAll("#fleet tr[data-verdict=stiction]")]
          .every((row) => row.cells[4].textContent.trim() !== "\u2013")""",
    )
    page.wait_for_timeout(FADED_MS)
    page.screenshot(path=images / "web-fleet.png")
    page.set_viewport_size(PHONE)
    page.screenshot(path=images / "web-phone.png")


if __name__ == "__main__":
    main()
