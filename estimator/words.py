"""What a window cannot tell, and why a criterion was taken, in sentences for a technician."""

from __future__ import annotations

import math

from estimator.estimate import Estimate
from estimator.outcomes import Verdict

__all__ = ["TIE", "criterion_reason", "identifiability"]

TIE = 0.03
"""BIC per sample within which neither criterion is the better one."""

_VAGUE = 0.5
_NOTHING = 0.05
_ANOTHER = 0.05
"""How far two stick bands are apart, as a share, to be worth a sentence."""


def identifiability(estimate: Estimate, span: float, *, sticky: bool) -> tuple[str, ...]:
    """Sentences about S and J; ``span`` turns shares of OP's span into units of OP.

    None where no sticky valve was found: there is nothing to tell then.
    """
    if not sticky:
        return ()
    band, jump = estimate.band.scaled(span), estimate.jump.scaled(span)
    found = []
    valves = [(span * peak.band, span * peak.jump, peak.share) for peak in estimate.peaks]
    told = [valve for valve in valves if abs(valve[0] - valves[0][0]) > _ANOTHER * valves[0][0]]
    if told:
        words = ", or ".join(
            f"S {s:.3g} with J {j:.3g} ({100.0 * share:.0f} %)"
            for s, j, share in (valves[0], *told)
        )
        found.append(f"different valves explain this window about equally well: {words}")
    elif band.high - band.low > _VAGUE * band.value:
        found.append(
            f"the stick band is vague in this window: anything from {band.low:.3g} to "
            f"{band.high:.3g} fits about as well"
        )
    if jump.low < _NOTHING * band.value:
        found.append(
            f"the slip jump cannot be told from this window: any value below {jump.high:.3g} fits "
            f"as well"
        )
    elif jump.high - jump.low > _VAGUE * jump.value:
        found.append(
            f"the slip jump is vague in this window: anything from {jump.low:.3g} to "
            f"{jump.high:.3g} fits about as well"
        )
    return tuple(found)


def criterion_reason(asked: str, estimate: Estimate, verdict: Verdict, nearer: float) -> str:
    """Why the estimate is under its criterion.

    ``asked`` is the caller's choice; ``nearer`` by how much BIC per sample the one-step errors are
    better than the whitened simulation errors, infinite where simulation favours no sticky valve.
    """
    if asked != "auto":
        return "as asked"
    if verdict is not Verdict.STICTION:
        return "the process that simulates PV, because no sticky valve was found"
    if math.isinf(nearer):
        return "simulation does not favour a sticky valve, one-step errors do"
    figure = f"({abs(nearer):.2f} BIC a sample)"
    if abs(nearer) <= TIE:
        valves = "the same valve" if estimate.criterion == "arx" else "different valves"
        return (
            f"one-step errors are about as likely as whitened simulation errors {figure}; "
            f"they mean {valves}"
        )
    if nearer > 0.0:
        return f"one-step errors are more likely than whitened simulation errors {figure}"
    return f"whitened simulation errors are more likely than one-step errors {figure}"
