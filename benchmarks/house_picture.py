"""The picture of the architecture: packages, their imports, and two walks through them.

    python -m benchmarks.house_picture [--images docs/images]

Boxes stand in the layers that `pyproject.toml` declares and import-linter checks. An arrow leads
from a package to one that it imports, unless other arrows lead there too; its width grows with the
number of imports.
Below are the steps of the walks of docs/architecture.md. Modules and names come from the code: one
that is not there is an error.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import grimp
import matplotlib
from matplotlib.patches import FancyBboxPatch

matplotlib.use("Agg")
from matplotlib import pyplot

__all__ = ["WALKS", "imports_between", "layers", "main", "missing_names", "without_detours"]

CORES = ("estimator", "compensator", "fmu_models")
"""Packages beside the layers: they compute, and know nothing of the adapter."""

WALKS: Mapping[str, Sequence[tuple[str, str]]] = {
    "one sample, from register to block": (
        ("fieldlink.daemon.sampling.device", "DeviceRunner"),
        ("fieldlink.links.modbus", "ModbusLink"),
        ("fieldlink.links.plan_reader", "PlanReader"),
        ("fieldlink.registers.decoder", "BlockDecoder"),
        ("fieldlink.daemon.loop", "LoopRunner"),
        ("fieldlink.daemon.windows.window", "Window"),
        ("fieldlink.daemon.estimation.pool", "EstimatorPool"),
        ("estimator.identify", "identify"),
        ("fieldlink.daemon.writeback.candidate", "Candidate"),
        ("fieldlink.daemon.writeback.rules", "Rules"),
        ("fieldlink.daemon.writeback.handover", "Handover"),
        ("fieldlink.registers.parameter_block", "ParameterBlock"),
    ),
    "one window, from file to verdict": (
        ("fieldlink.cli.identify", "identify"),
        ("fieldlink.site.recording", "read_recording"),
        ("estimator.window", "screen"),
        ("estimator.rows", "rows_of"),
        ("estimator.evidence.weighing", "weigh"),
        ("estimator.search.valves", "find_valves"),
        ("estimator.evidence.verdict", "judge"),
        ("estimator.intervals.posterior", "sample_posterior"),
        ("estimator.report", "describe"),
    ),
}
"""By title, the module of each step and the name in it that does the work."""

_ROOT = Path(__file__).resolve().parents[1]
_COLOURS = ("#1f6f8b", "#b3541e")


def layers() -> list[list[str]]:
    """Return the packages of the adapter, top layer first, as import-linter holds them."""
    settings = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (found,) = (one for one in contracts if one["name"] == "the adapter's layers")
    return [[name.strip() for name in layer.split("|")] for layer in found["layers"]]


def imports_between(packages: Sequence[str]) -> Counter[tuple[str, str]]:
    """Count the imports from modules of one package to modules of another."""
    graph = grimp.build_graph("fieldlink", *CORES)
    counts: Counter[tuple[str, str]] = Counter()
    for module in graph.modules:
        importer = _package_of(module, packages)
        for imported in graph.find_modules_directly_imported_by(module):
            target = _package_of(imported, packages)
            if importer and target and importer != target:
                counts[importer, target] += 1
    return counts


def _package_of(module: str, packages: Sequence[str]) -> str | None:
    return next((p for p in packages if module == p or module.startswith(p + ".")), None)


def without_detours(
    counts: Mapping[tuple[str, str], int],
) -> dict[tuple[str, str], int]:
    """Leave out every import of a package that another imported package leads to."""
    targets: dict[str, set[str]] = {}
    for importer, target in counts:
        targets.setdefault(importer, set()).add(target)

    def reach(package: str) -> set[str]:
        below = targets.get(package, set())
        return below.union(*(reach(target) for target in below))

    return {
        (importer, target): count
        for (importer, target), count in counts.items()
        if not any(target in reach(other) for other in targets[importer])
    }


def missing_names() -> Iterator[str]:
    """Give every step of a walk whose module or name is not in the code."""
    for steps in WALKS.values():
        for module, name in steps:
            found = importlib.util.find_spec(module)
            if found is None or found.origin is None:
                yield module
                continue
            tree = ast.parse(Path(found.origin).read_text(encoding="utf-8"))
            if name not in {getattr(node, "name", None) for node in tree.body}:
                yield f"{module}.{name}"


def _places(rows: Sequence[Sequence[str]]) -> dict[str, tuple[float, float]]:
    """Return the middle of every box: layers above each other, the cores in a column beside."""
    places = {}
    for line, row in enumerate(rows):
        for i, name in enumerate(row):
            aside = 1.5 * (-1) ** line if len(row) == 1 and 0 < line < len(rows) - 1 else 0.0
            places[name] = (4.4 + aside + 3.0 * (i - (len(row) - 1) / 2), -1.0 * line)
    for i, name in enumerate(CORES):
        places[name] = (10.6, -(len(rows) - 1) * (i + 1) / (len(CORES) + 1) - 0.5)
    return places


def _draw_box(axes: Any, middle: tuple[float, float], text: str, colour: str, width: float) -> None:
    x, y = middle
    corner = (x - width / 2, y - 0.27)
    box = FancyBboxPatch(
        corner, width, 0.54, boxstyle="round,pad=0.02", fc="white", ec=colour, lw=1.4, zorder=3
    )
    axes.add_patch(box)
    axes.text(x, y, text, ha="center", va="center", fontsize=9, zorder=4)


def _draw_house(axes: Any) -> None:
    rows = layers()
    packages = [name for row in rows for name in row] + list(CORES)
    places = _places(rows)
    for (importer, target), count in without_detours(imports_between(packages)).items():
        (x0, y0), (x1, y1) = places[importer], places[target]
        beside = target in CORES and importer not in CORES
        if beside:
            x0, x1 = x0 + 0.97, x1 - 0.97
        else:
            y0, y1 = y0 - 0.27, y1 + 0.27
        line = {"color": "#5f7380", "lw": 0.6 + 0.4 * count**0.5, "alpha": 0.8}
        bend = "arc3,rad=0.08" if not beside and abs(y0 - y1) > 1.0 else "arc3,rad=0"
        axes.annotate(
            "",
            (x1, y1),
            (x0, y0),
            arrowprops={"arrowstyle": "-|>", "connectionstyle": bend, "shrinkA": 0, **line},
            zorder=1,
        )
    for name, place in places.items():
        colour = "#5b4a8a" if name in CORES else "#333333"
        _draw_box(axes, place, name.removeprefix("fieldlink."), colour, 1.9)
    axes.set(xlim=(-0.6, 12.0), ylim=(-len(rows) + 0.4, 0.6))
    axes.set_title("Packages in their layers, and which import which", loc="left", fontsize=11)


def _draw_walk(axes: Any, title: str, steps: Sequence[tuple[str, str]], colour: str) -> None:
    each_row = 4
    for number, (module, name) in enumerate(steps):
        x, y = 3.15 * (number % each_row), -0.95 * (number // each_row)
        if number:
            before = number - 1
            x0, y0 = 3.15 * (before % each_row), -0.95 * (before // each_row)
            start, end = (
                ((x0 + 1.35, y0), (x - 1.35, y)) if y == y0 else ((x0, y0 - 0.3), (x, y + 0.3))
            )
            arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.4}
            axes.annotate("", end, start, arrowprops=arrow, zorder=1)
        short = module.removeprefix("fieldlink.").rpartition(".")
        text = f"{number + 1}  {name}\n{short[0]}.{short[2]}".strip()
        _draw_box(axes, (x, y), text, colour, 2.66)
    lines = (len(steps) - 1) // each_row
    axes.set(xlim=(-1.5, 11.1), ylim=(-0.95 * lines - 0.45, 0.45))
    axes.set_title(title.capitalize(), loc="left", fontsize=11)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--images", type=Path, default=Path("docs/images"), help="folder")
    folder: Path = parser.parse_args(arguments).images
    missing = list(missing_names())
    if missing:
        print(f"the walk names what the code does not have: {', '.join(missing)}", file=sys.stderr)
        return 2
    folder.mkdir(parents=True, exist_ok=True)
    figure, parts = pyplot.subplots(
        3, 1, figsize=(10, 12), height_ratios=(10, 3.0, 3.0), layout="constrained"
    )
    _draw_house(parts[0])
    for axes, colour, (title, steps) in zip(parts[1:], _COLOURS, WALKS.items(), strict=True):
        _draw_walk(axes, title, steps, colour)
    for axes in parts:
        axes.set_axis_off()
    figure.savefig(folder / "architecture.png", dpi=110)
    pyplot.close(figure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
