"""Rehearsals: a scenario file says what happens in a plant and which results are expected.

    file = load_scenario(find_scenario("growing-stiction"))
    rehearsal = rehearse(file)
    rehearsal.passed, rehearsal.findings

The daemon, the write-back, the PLC's block reader and the compensator are the real ones; only time
is virtual.
"""

from fieldlink.lab.rehearse.errors import ScenarioError
from fieldlink.lab.rehearse.injected_defects import Defect
from fieldlink.lab.rehearse.load import (
    ScenarioFile,
    find_scenario,
    load_scenario,
    shipped_scenarios,
)
from fieldlink.lab.rehearse.run import Rehearsal, rehearse

__all__ = [
    "Defect",
    "Rehearsal",
    "ScenarioError",
    "ScenarioFile",
    "find_scenario",
    "load_scenario",
    "rehearse",
    "shipped_scenarios",
]
