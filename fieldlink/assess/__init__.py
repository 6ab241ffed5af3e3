"""Recorded loops of a whole site, judged into one ranked table: `fieldlink assess`.

Readers, workers, engines and the table live here; the judging itself is the estimator's.
"""

from fieldlink.assess.errors import AssessError
from fieldlink.assess.job import Columns, Cut, Job, Judging, Piece, Place

__all__ = ["AssessError", "Columns", "Cut", "Job", "Judging", "Piece", "Place"]
