from __future__ import annotations

import importlib.util
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import trustme

if TYPE_CHECKING:
    from tests.links.fake_device import FakeDevice

HELPER = Path(__file__).resolve().parent / "fake_device.py"


def load_helper(path: Path) -> Any:
    """Import a helper that lies beside the tests; they are no package."""
    name = f"fieldlink_tests_{path.stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture
async def new_device() -> AsyncIterator[Callable[..., FakeDevice]]:
    made = []

    def make(**settings: Any) -> FakeDevice:
        device: FakeDevice = load_helper(HELPER).FakeDevice(**settings)
        made.append(device)
        return device

    yield make
    for device in made:
        await device.stop()


@pytest.fixture
async def device(new_device: Callable[..., FakeDevice]) -> FakeDevice:
    running = new_device()
    await running.start()
    return running


@pytest.fixture
def certificates(tmp_path: Path) -> Callable[[str], Path]:
    """Write a CA, a PLC's and a client's certificate, and a stranger's; return paths by name."""
    authority, other = trustme.CA(), trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    other.cert_pem.write_to_path(tmp_path / "other_ca.pem")
    for name, certificate in {
        "plc": authority.issue_cert("127.0.0.1", "plc.plant.test"),
        "named": authority.issue_cert("plc.plant.test"),
        "client": authority.issue_cert("fieldlink.plant.test"),
        "stranger": other.issue_cert("fieldlink.plant.test"),
    }.items():
        certificate.private_key_pem.write_to_path(tmp_path / f"{name}.key")
        certificate.cert_chain_pems[0].write_to_path(tmp_path / f"{name}.pem")
    return lambda name: tmp_path / name
