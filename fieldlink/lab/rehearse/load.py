"""Finds and reads scenario files: shipped ones by name, anybody's by path."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

from fieldlink.file_at import why_no_file
from fieldlink.lab.rehearse.errors import ScenarioError
from fieldlink.lab.rehearse.models import Scenario
from fieldlink.site.errors import SiteError, nearest
from fieldlink.site.toml_source import TomlSource
from fieldlink.site.validation import validated

__all__ = ["ScenarioFile", "find_scenario", "load_scenario", "shipped_scenarios"]


@dataclass(frozen=True, slots=True)
class ScenarioFile:
    """A checked scenario and where it comes from."""

    name: str
    path: Path
    scenario: Scenario

    def changed(self, **summary: object) -> ScenarioFile:
        """The same with other values of keys of its table ``[scenario]``, which are not checked."""
        table = self.scenario.scenario.model_copy(update=summary)
        return replace(self, scenario=self.scenario.model_copy(update={"scenario": table}))


def shipped_scenarios() -> tuple[Path, ...]:
    """Return the scenarios that come with fieldlink, in order of name."""
    folder = Path(str(files("fieldlink.lab.rehearse") / "scenarios"))
    return tuple(sorted(folder.glob("*.toml")))


def find_scenario(name: str) -> Path:
    """Return the file that a user means: one that exists, else a shipped one of that name.

    Raises:
        ScenarioError: there is neither.
    """
    path = Path(name)
    why = why_no_file(path)
    if why is None:
        return path
    shipped = {file.stem: file for file in shipped_scenarios()}
    if name in shipped:
        return shipped[name]
    if path.suffix == ".toml" or path.parent != Path():
        raise ScenarioError(f"there is no scenario file {path} ({why}); correct the path")
    raise ScenarioError(
        f"there is no shipped scenario {name!r}; {nearest(name, shipped)} "
        "The path of a file of your own ends in .toml"
    )


def load_scenario(path: Path) -> ScenarioFile:
    """Read a scenario file.

    Raises:
        SiteError: with every problem found, its line, key, value and remedy.
    """
    source = TomlSource(path)
    scenario = validated(source, Scenario)
    fmu = scenario.plant.fmu
    # Here and not with the site that is made of it, whose file nobody knows.
    if Path(fmu).suffix and (why := why_no_file(path.parent / fmu)) is not None:
        missing = f"there is no file {fmu} ({why})"
        raise SiteError([source.problem(("plant", "fmu"), missing, "correct the path")])
    return ScenarioFile(path.stem, path, scenario)
