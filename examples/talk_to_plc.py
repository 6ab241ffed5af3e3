"""Read a PLC over Modbus TCP: all tags of a site in one scan, with quality.

    fieldlink plant site_configs/demo.toml       # a simulated PLC, in another terminal
    python examples/talk_to_plc.py [SITE.toml]

A scan reads OP, PV and the cycle counter of a loop with one request, so they belong together.
Nothing is written.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from fieldlink.links import Reading, open_link
from fieldlink.site import load_site

SHIPPED = Path(__file__).resolve().parents[1] / "site_configs" / "demo.toml"


async def main(site_file: Path) -> dict[str, Reading]:
    """Print and return the readings of the site's first device."""
    site = load_site(site_file)
    name = next(iter(site.devices))
    link = open_link(site, name)
    await link.open()
    try:
        scan = await link.scan()
    finally:
        await link.close()
    for tag, reading in scan.readings.items():
        print(f"{tag:15} {reading.value:10.4g}  {reading.quality.name.lower()}")
    return dict(scan.readings)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED))
