"""Why a loop swings and which loop started it: the numeric room's names, for users.

    from fieldlink.diagnosis import diagnose
    found = diagnose(op, pv, sp, period=1.0)
    found.first.name, found.first.evidence, found.first.action

Arrays in, results out; ``fieldlink diagnose`` reads files and stores.
"""

from estimator.diagnosis import *  # noqa: F403  (one list of names, kept there)
from estimator.diagnosis import __all__ as __all__
