"""Loops and plants by which the numbers of the diagnosis were chosen; never those of the report.

The report family has plants and controllers of its own and imports nothing from here.
"""

from benchmarks.diagnosis_families.tuning.events import PLANTS, draw_event
from benchmarks.diagnosis_families.tuning.singles import draw_loop

__all__ = ["PLANTS", "draw_event", "draw_loop"]
