"""Fixtures every test folder shares."""

from __future__ import annotations

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded loops that stands beside the project; the test is skipped without it."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the recorded loops (../shared/data) are not on this machine")
    return SHARED_DATA
