"""From a step test to a scenario: the FMU behind a sticky valve and a PI, ready to rehearse.

The FMU is a process without a valve; He's valve of the wanted size stands before its input.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

from fieldlink.lab.fmu.errors import FmuError
from fieldlink.lab.fmu.step_test import LoopWish, StepResponse
from fieldlink.unfinished_file import created
from fmu_models import FmuSummary, StartValue

__all__ = ["write_scenario"]

_WINDOW_LAGS = 60.0
"""Lags in a window: several cycles of a sticky valve, whose period is some four to ten lags."""
_NOISE = 0.01
"""Of the set-point's step, standard deviation: a usual transmitter, seen and not in the way."""
_LEAST_WINDOW, _MOST_WINDOW = 400, 1500


def write_scenario(fmu: FmuSummary, wish: LoopWish, response: StepResponse, file: Path) -> None:
    """Write the scenario of a loop around the FMU: found, written, compensated.

    Raises:
        FmuError: the file exists or cannot be written.
    """
    gain, integral_time = response.tune()
    period = response.period
    lags = max(response.lag + response.dead_time, 4.0 * period)
    window = round(min(max(_WINDOW_LAGS * lags / period, _LEAST_WINDOW), _MOST_WINDOW))
    seconds = window * period
    reach = max(response.lag, 5.0 * period) if response.integrates else 1.0
    moved = response.start + 4.0 * response.gain * reach
    begin = 20.0 * period
    rows = {
        "start": response.start,
        "begin": begin,
        "moved": moved,
        "again": seconds + begin,
        "between": 0.5 * (response.start + moved),
        "duration": 5.0 * seconds,
        "window": window,
        "noise": _NOISE * abs(moved - response.start),
        "fmu": json.dumps(os.path.relpath(fmu.file, file.parent)),
        "period": period,
        "op_name": json.dumps(wish.op),
        "pv_name": json.dumps(wish.pv),
        "starts": ", ".join(
            f"{json.dumps(name)} = {_as_toml(value)}"
            for name, value in wish.all_start_values(response.op).items()
        ),
        "op_scale": "" if wish.scale == 1.0 else f"op_scale = {wish.scale:.6g}\n",
        "gain": gain,
        "integral_time": integral_time,
        "S": wish.stick_band,
        "J": wish.slip_jump,
        "title": json.dumps(f"A sticky valve before {fmu.name}"),
        "name": fmu.file.name,
        "first": 1.6 * seconds,
        "taken": 3.0 * seconds,
        "spread": math.ceil(0.2 * seconds),
        "seconds": seconds,
        "late": 4.0 * seconds,
    }
    numbers = {key: f"{v:.6g}" if isinstance(v, float) else v for key, v in rows.items()}
    try:
        with created(file) as stream:
            stream.write(_TEMPLATE.format(**numbers))
    except FileExistsError as error:
        raise FmuError(f"{file}: it exists; remove it, or name another with --output") from error
    except OSError as error:
        raise FmuError(
            f"{file}: it cannot be written ({error.strerror}); check the folder and the free space"
        ) from error


def _as_toml(value: StartValue) -> str:
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value)


_TEMPLATE = """\
# A step in each of the first two windows: in a cycle that only repeats itself, a narrower stick
# band with a longer dead time explains PV as well.
setpoint = [
  [0, {start}], [{begin}, {start}], [{begin}, {moved}], [{again}, {moved}], [{again}, {between}],
]

[scenario]
title = {title}
text = \"\"\"
{name} behind a valve with stick band {S} % and slip jump {J} % of OP, under a PI that was tuned
from a step test: the loop oscillates, the valve is identified, its model is written, and the
compensator takes the oscillation away.
\"\"\"
duration = {duration}
defects = ["never-stiction", "lost-blocks"]  # each must make it fail: --self-test

[plant]
fmu = {fmu}
period = {period}
parameters = {{ {starts} }}

[plant.variables]
op = {op_name}
{op_scale}pv = {pv_name}

[controller]
kind = "pi"
gain = {gain}
integral_time = {integral_time}
compensate = true

[valve]
in_front = true
stick_band = [[0, {S}]]
slip_jump = [[0, {J}]]

# Without noise PV repeats one value while the valve rests, as a broken transmitter does.
[[sensor]]
kind = "noise"
begin = 0
end = {duration}
size = {noise}

[daemon]
window = {window}
min_windows = 2
write_back = true

[[expect]]
kind = "verdict"
verdict = "stiction"
before = {first}

[[expect]]
kind = "estimate"
of = "stick_band"
tolerance = 0.2
windows = "any"
before = {first}

[[expect]]
kind = "take_over"
by = {taken}

[[expect]]
kind = "pv_std"
first = [{spread}, {seconds}]
then = [{late}, {duration}]
at_most = 0.6
"""
