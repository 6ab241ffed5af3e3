"""The same FMUs in Fieldlink and in FMPy's own `simulate_fmu`: do the samples agree?

    python -m benchmarks.fmu_zoo [--out docs/benchmarks]

The zoo is what the tests make or have at hand: plants of the catalogue, hand-written C for FMI 1, 2
and 3 (time and state events, event mode, early return, arrays), pythonfmu, pythonfmu3, and the FMUs
that OpenModelica exported in the wheel of gemseo-fmu, where it is installed. Differences are the
largest of all outputs and samples, relative to the spread of the output. Limits: 1e-9 for
co-simulation, 1e-4 for model exchange, where both integrate with CVode at one tolerance but step
differently.
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import fmpy
import numpy as np

from benchmarks.report import heading, keep, machine, table
from fmu_models import fmu_path, open_plant, summarise
from tests.fmu_models import mini_fmus, odd_fmus, python_fmus

__all__ = ["LIMITS", "Case", "cases", "difference", "main"]

LIMITS = {"co-simulation": 1e-9, "model exchange": 1e-4}
_FMPY = {"co-simulation": "CoSimulation", "model exchange": "ModelExchange"}
_MODELICA = (
    *("MassSpringSystem", "MassSpringSubSystem1", "MassSpringSubSystem2"),
    *("ramp", "add", "Mass_Damper"),
)
_TOLERANCE = 1e-6
"""Relative, of FMPy's CVode; ours is the same where the FMU recommends none."""


@dataclass(frozen=True)
class Case:
    """One FMU in one kind, from its start values for some steps."""

    name: str
    file: Path
    kind: str
    step: float
    steps: int = 40
    parameters: Mapping[str, float] = field(default_factory=dict)


def _openmodelica() -> Path | None:
    spec = importlib.util.find_spec("gemseo_fmu")
    if spec is None or spec.origin is None or fmpy.platform != "linux64":
        return None
    folder = Path(spec.origin).parent / "problems" / "fmu_files" / "linux"
    return folder if folder.is_dir() else None


def cases(folder: Path) -> Iterator[Case]:
    """Make the zoo in ``folder`` and yield it."""
    for name, step in (("example1", 1.0), ("ph", 5.0), ("physical", 1.0)):
        for version in (2, 3):
            parameters = {"controller": 1.0, "op_start": 40.0}
            file = fmu_path(name, version)
            yield Case(f"{name}, FMI {version}", file, "co-simulation", step, 200, parameters)
    mini, odd = mini_fmus.make(folder), odd_fmus.make(folder)
    flow = {"tank.inflow[1]": 3.0}
    for key, kinds in (
        ("fmi1-cs", ["co-simulation"]),
        ("fmi1-me", ["model exchange"]),
        ("fmi2", ["co-simulation", "model exchange"]),
    ):
        for kind in kinds:
            yield Case(f"C, tank with events, {key}", mini[key], kind, 0.25, 40, flow)
    yield Case("C, FMI 3, arrays", odd["plain"], "co-simulation", 0.25, 40)
    yield Case("C, FMI 3, event mode, early return", odd["events"], "co-simulation", 0.25, 40)
    yield Case("C, FMI 3, state and time events", odd["plain"], "model exchange", 0.25, 40)
    for tool in python_fmus.TOOLS:
        if python_fmus.is_installed(tool):
            (folder / tool).mkdir(exist_ok=True)
            file = python_fmus.build(tool, folder / tool)
            yield Case(f"{tool}, tank", file, "co-simulation", 0.1, 40, {"inflow": 2.0})
    modelica = _openmodelica()
    if modelica is not None:
        for name in _MODELICA:
            file = modelica / f"{name}.fmu"
            for kind in summarise(file).kinds:
                yield Case(f"OpenModelica, {name}", file, kind, 0.037, 80)


def difference(case: Case) -> tuple[float, int]:
    """Return the largest relative difference of all outputs, and how many columns were compared."""
    with open_plant(
        case.file, kind=case.kind, period=case.step, parameters=case.parameters
    ) as plant:
        ours = plant.run(case.steps, {})
    description = fmpy.read_model_description(str(case.file), validate=False)
    named = {v.name: v for v in description.modelVariables}
    outputs = [n for n in named if n in ours or any(k.startswith(f"{n}[") for k in ours)]
    theirs = _fmpys(case, description, outputs)
    start = float(getattr(description.defaultExperiment, "startTime", None) or 0.0)
    moments = start + case.step * np.arange(1, case.steps + 1)
    close = np.isclose(theirs["time"][:, None], moments[None, :], rtol=1e-9, atol=1e-9)
    rows = theirs.size - 1 - np.argmax(close[::-1], axis=0)  # the last: after an event
    assert close.any(axis=0).all()
    worst, columns = 0.0, 0
    for name in outputs:
        values = np.asarray(theirs[name], dtype=np.float64).reshape(theirs.size, -1)
        keys = [k for k in ours if k == name or k.startswith(f"{name}[")]
        for i, key in enumerate(keys):
            spread = max(np.ptp(values[:, i]), np.abs(values[:, i]).max(), 1e-300)
            gap = np.abs(values[rows, i] - ours[key]).max() / spread
            worst, columns = max(worst, float(gap)), columns + 1
    return worst, columns


def _fmpys(case: Case, description: object, outputs: list[str]) -> np.ndarray:
    interface = getattr(description, "coSimulation", None)
    events = case.kind == "co-simulation" and bool(getattr(interface, "hasEventMode", False))
    options = {"use_event_mode": True, "early_return_allowed": True} if events else {}
    if case.kind == "model exchange":
        options |= {"relative_tolerance": _TOLERANCE, "record_events": True}
    experiment = getattr(description, "defaultExperiment", None)
    start = float(getattr(experiment, "startTime", None) or 0.0)
    result: np.ndarray = fmpy.simulate_fmu(
        str(case.file),
        fmi_type=_FMPY[case.kind],
        start_time=start,
        stop_time=start + case.steps * case.step,
        output_interval=case.step,
        start_values=dict(case.parameters),
        output=outputs,
        validate=False,
        set_stop_time=False,
        **options,
    )
    return result


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare the whole zoo and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder for the result")
    options = parser.parse_args(arguments)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(Path(folder)):
            gap, columns = difference(case)
            good = "yes" if gap <= LIMITS[case.kind] else "NO"
            rows.append([case.name, case.kind, case.steps, columns, f"{gap:.1e}", good])
    head = ["FMU", "kind", "steps", "columns", "difference", "within the limit"]
    text = table(head, rows)
    print(text)
    about = heading("fmu_zoo", __doc__, arguments)
    keep(options.out, "fmu_zoo", f"{about}\n\n{text}", {"rows": rows, "machine": machine()})


if __name__ == "__main__":
    main()
