"""Fixtures every test folder shares."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

# A test fails for what it asserts, not for how busy the machine is.
settings.register_profile("fieldlink", deadline=None)
settings.load_profile("fieldlink")

SHARED_DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The recorded loops that stand beside the project; without them the test is skipped."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the recorded loops (../shared/data) are not on this machine")
    return SHARED_DATA
