"""The report family: loops on which the estimator is judged and by which nothing is chosen.

Written apart from the tuning family and from the estimator: its own valve laws, processes,
controllers, loads and historians. `draw` gives a loop, `KINDS` names what there is.
"""

from benchmarks.families.report.draw import draw
from benchmarks.families.report.kinds import KINDS, Kind

__all__ = ["KINDS", "Kind", "draw"]
