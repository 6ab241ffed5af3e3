"""Loops and plants on which the diagnosis is judged and by which nothing was chosen.

Written apart from the tuning family: position-form controllers with a filtered derivative, Kano's
valve, processes in state space at five inner steps a sample, disturbances at other places.
"""

from benchmarks.diagnosis_families.report.events import PLANTS, draw_event
from benchmarks.diagnosis_families.report.singles import draw_loop

__all__ = ["PLANTS", "draw_event", "draw_loop"]
