"""Simulated loops for choosing the estimator's numbers; its report is judged on another family.

`draw(kind, sticky, seed)` returns a `RecordedLoop` with the truth about its valve. `valves` holds
the friction laws, `process` processes and tunings, `closed_loop` the simulation, `loads` the
disturbances, `scenes` what each kind combines, `records` what a historian does to signals.
`python -m benchmarks.families.tuning --plot FILE.png` draws a contact sheet.
"""

from benchmarks.families.tuning.draw import HEALTHY_KINDS, KINDS, STICKY_KINDS, draw

__all__ = ["HEALTHY_KINDS", "KINDS", "STICKY_KINDS", "draw"]
