"""Five published models of a sticky valve behind one interface.

    valve = KanoValve(stick_band=4.0, slip_jump=1.0)
    stem = valve.simulate(op, stem0=op[0])

Each model is a frozen dataclass whose fields are its parameters, in units of OP. ``start`` gives
a state, ``step`` advances it by one sample, ``simulate`` runs a whole signal in compiled code and
does exactly what repeated ``step`` does.

In all of them ``S = fS + fD`` (stick band plus dead band) and ``J = fS - fD`` (slip jump), so that
``fS = (S + J) / 2`` and ``fD = (S - J) / 2``. Equal parameters do not mean equal behaviour:

* He's valve comes to rest after every sample; Kano's and Choudhury's keep following OP until it
  turns or stops. With ``J = 0`` He's and Kano's are the same backlash.
* The smoothed valve tends to He's as ``tau`` grows (from ``tau = 1e4`` they agree wherever OP is
  not within about ``20 / tau`` of the band's edge).
* The semi-physical valve with ``overshoot = 1`` is He's.
"""

from estimator.valves.base import SlipStickValve, ValveState
from estimator.valves.choudhury import ChoudhuryValve
from estimator.valves.he import HeValve, SemiPhysicalValve, SmoothedValve
from estimator.valves.kano import KanoValve

__all__ = [
    "ChoudhuryValve",
    "HeValve",
    "KanoValve",
    "SemiPhysicalValve",
    "SlipStickValve",
    "SmoothedValve",
    "ValveState",
]
