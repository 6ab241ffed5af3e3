"""Every public name exists, says what it is, and comes without the optional solver."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import subprocess
import sys
import typing
from collections.abc import Iterator

import pytest

import estimator

MODULES = (
    "estimator",
    *sorted(m.name for m in pkgutil.walk_packages(estimator.__path__, "estimator.")),
)


def callables_of(owner: object) -> Iterator[tuple[str, object]]:
    """The public functions, methods and properties of a class, by name."""
    for name, member in vars(owner).items():
        found = member.fget if isinstance(member, property) else member
        found = getattr(found, "__func__", found)
        if not name.startswith("_") and inspect.isfunction(found):
            yield name, found


@pytest.mark.parametrize("name", MODULES)
def test_a_module_names_what_is_public_and_says_what_it_is_for(name: str) -> None:
    module = importlib.import_module(name)
    assert module.__doc__
    # a room that shows nothing of its own holds modules that do
    room = hasattr(module, "__path__") and not vars(module).get("__all__", ())
    if not name.rpartition(".")[2].startswith("_") and not room:
        assert module.__all__
    missing = [public for public in getattr(module, "__all__", ()) if not hasattr(module, public)]
    assert missing == []


@pytest.mark.parametrize("name", MODULES)
def test_every_public_name_has_a_docstring(name: str) -> None:
    module = importlib.import_module(name)
    silent = []
    for public in getattr(module, "__all__", ()):
        item = getattr(module, public)
        if inspect.isclass(item):
            # a dataclass without a docstring gets its signature for one
            if not item.__doc__ or item.__doc__.startswith(f"{public}("):
                silent.append(public)
            silent += [f"{public}.{n}" for n, member in callables_of(item) if not member.__doc__]
        elif callable(item) and typing.get_origin(item) is None and not item.__doc__:
            silent.append(public)
    assert silent == []


@pytest.mark.parametrize(
    "function",
    [estimator.identify, estimator.track, estimator.grid_search, estimator.nlp_paper,
     estimator.nlp_polish],
)  # fmt: skip
def test_a_docstring_names_every_argument_and_the_errors(function: object) -> None:
    text = inspect.getdoc(function) or ""
    unsaid = [name for name in inspect.signature(function).parameters if f"{name}" not in text]
    assert unsaid == []
    assert "Raises:" in text
    assert "shape" in text


def test_casadi_is_not_needed_to_import() -> None:
    code = "import sys; sys.modules['casadi'] = None; from estimator import nlp_paper, identify"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
