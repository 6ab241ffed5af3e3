"""Fixtures every test folder shares."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
import structlog
from hypothesis import settings

# A test fails for what it asserts, not for how busy the machine is, nor for the luck of a draw:
# the suite has the same examples everywhere, others are searched with --hypothesis-profile search.
settings.register_profile("fieldlink", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None)
settings.load_profile("fieldlink")


def pytest_configure() -> None:
    """Keep what Python compiles, and hear Ctrl-C for the tests that send it.

    Where ``PYTHONDONTWRITEBYTECODE`` is set, every worker and every process that a test starts
    would compile all sources again: a sixth of the suite. What a script runs with ``&`` begins
    without Ctrl-C.
    """
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Take what stays to the end, tests and modules, out of the garbage collector's sight.

    It would look at a million objects again and again and find none to free: a fifth of what it
    takes to collect the tests, a tenth of those that compute little.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that hold slow tests: begun last, one of them would be waited for.

    First of all those whose processes stand back for others: beside tests that compute they take
    several times as long as beside each other.
    """
    waits, slow = (
        {item.path for item in items if item.get_closest_marker(name)} for name in ("waits", "slow")
    )
    items.sort(key=lambda item: (item.path not in waits, item.path not in slow))


@pytest.fixture(autouse=True)
def _logging_of_its_own() -> Iterator[None]:
    """What a test configures ends with it: a command logs to the stderr that pytest gave it."""
    root = logging.getLogger()
    handlers = list(root.handlers)
    yield
    structlog.reset_defaults()
    for handler in set(root.handlers) - set(handlers):
        root.removeHandler(handler)


SHARED_DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The recorded loops that stand beside the project; without them the test is skipped."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the recorded loops (../shared/data) are not on this machine")
    return SHARED_DATA
