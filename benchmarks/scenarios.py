"""Every shipped rehearsal, with many seeds, under other instruction sets.

``python -m benchmarks.scenarios`` runs each shipped scenario with ``--seeds`` seeds under each
named setting, in a process of its own, and prints scenario, setting, seed and outcome. A scenario
states what must hold for any noise, so no outcome may depend on the seed, nor on the processor.
``--only`` takes some scenarios, ``--settings`` some settings. A process that cannot run under a
setting (the machine lacks the instructions) is reported as such and counts as neither.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks.processors import SETTINGS, environment_of, lacking
from benchmarks.report import heading, keep, machine, table
from fieldlink.lab.rehearse import load_scenario, rehearse, shipped_scenarios

__all__ = ["Outcome", "main"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run.

    Attributes:
        scenario, setting, seed: of the run.
        passed: None where the process could not run.
        words: what did not come as expected.
    """

    scenario: str
    setting: str
    seed: int
    passed: bool | None
    words: str


def _run_here(path: Path, seeds: Sequence[int]) -> list[dict[str, object]]:
    """Run one scenario in this process, one seed after the other."""
    found: list[dict[str, object]] = []
    file = load_scenario(path)
    for seed in seeds:
        run = rehearse(file.changed(seed=seed))
        missed = [f"{f.expected}: {f.found}" for f in run.findings if not f.passed]
        found.append({"seed": seed, "passed": run.passed, "words": "; ".join(missed)})
    return found


def _run_apart(path: Path, setting: str, seeds: Sequence[int]) -> list[Outcome]:
    """Run one scenario under a setting in a process of its own."""
    if (needed := lacking(setting)) is not None:
        words = f"did not run: this processor has no {needed}"
        return [Outcome(path.stem, setting, seeds[0], None, words)]
    command = [sys.executable, "-m", "benchmarks.scenarios", "--here", str(path)]
    command += ["--numbers", *map(str, seeds)]
    done = subprocess.run(
        command,
        env=environment_of(setting),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        words = (done.stderr.strip().splitlines() or ["no words"])[-1]
        return [Outcome(path.stem, setting, seeds[0], None, f"did not run: {words}")]
    lines = json.loads(done.stdout.strip().splitlines()[-1])
    return [
        Outcome(path.stem, setting, int(line["seed"]), bool(line["passed"]), str(line["words"]))
        for line in lines
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run; exit code 1 when a run did not come as expected."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", nargs="*", default=[], help="scenarios; all unless given")
    parser.add_argument("--settings", nargs="*", default=list(SETTINGS), choices=list(SETTINGS))
    parser.add_argument("--workers", type=int, default=1, help="processes at a time")
    parser.add_argument("--out", type=Path, help="folder for the table")
    parser.add_argument("--here", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--numbers", nargs="*", type=int, default=[], help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.here is not None:
        print(json.dumps(_run_here(options.here, options.numbers)))
        return 0
    paths = [p for p in shipped_scenarios() if not options.only or p.stem in options.only]
    seeds = list(range(1, options.seeds + 1))
    jobs = [(path, setting) for setting in options.settings for path in paths]
    outcomes: list[Outcome] = []
    with ThreadPoolExecutor(options.workers) as pool:
        for found in pool.map(lambda job: _run_apart(job[0], job[1], seeds), jobs):
            for o in found:
                state = "could not run" if o.passed is None else "passed" if o.passed else "FAILED"
                print(f"{o.scenario:22s} {o.setting:9s} seed {o.seed:3d}  {state}  {o.words}")
            sys.stdout.flush()
            outcomes += found
    rows = []
    for path, setting in jobs:
        mine = [o for o in outcomes if (o.scenario, o.setting) == (path.stem, setting)]
        held = sum(o.passed is True for o in mine)
        ran = sum(o.passed is not None for o in mine)
        rows.append((path.stem, setting, f"{held}/{ran}"))
    text = heading("scenarios", __doc__, arguments)
    text += table(("scenario", "setting", "passed"), rows)
    print(text)
    keep(options.out, "scenarios", text, {"machine": machine(), "rows": rows})
    return int(any(o.passed is False for o in outcomes))


if __name__ == "__main__":
    raise SystemExit(main())
