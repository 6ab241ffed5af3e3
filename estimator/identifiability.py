"""What a window cannot tell, in sentences for a technician."""

from __future__ import annotations

from estimator.estimate import Estimate

__all__ = ["dead_time_bound", "identifiability"]

_VAGUE = 0.5
"""Width of an interval, as a share of its value, from which it is called vague."""
_NOTHING = 0.05
"""Slip jump, as a share of the stick band, that cannot be distinguished from zero."""
_ANOTHER = 0.05
"""How far two stick bands are apart, as a share, to be worth a sentence."""


def identifiability(estimate: Estimate, span: float, *, sticky: bool) -> tuple[str, ...]:
    """Sentences about S and J; ``span`` turns shares of OP's span into units of OP.

    None where no sticky valve was found.
    """
    if not sticky:
        return ()
    band, jump = estimate.band.scaled(span), estimate.jump.scaled(span)
    found = []
    if estimate.varies > 0.0:
        varies = span * estimate.varies
        found.append(
            f"the valve's friction changes from slip to slip: S and J are means, single stick "
            f"bands deviate from S by {varies:.2g} ({varies / band.value:.0%})"
        )
    valves = [(span * peak.band, span * peak.jump, peak.share) for peak in estimate.peaks]
    apart = [valve for valve in valves if abs(valve[0] - valves[0][0]) > _ANOTHER * valves[0][0]]
    if apart:
        words = ", or ".join(
            f"S {s:.3g} with J {j:.3g} ({100.0 * share:.0f} %)"
            for s, j, share in (valves[0], *apart)
        )
        found.append(f"different valves explain this window about equally well: {words}")
    elif band.high - band.low > _VAGUE * band.value:
        found.append(
            f"the stick band is vague in this window: anything from {band.low:.3g} to "
            f"{band.high:.3g} fits about as well"
        )
    if jump.low < _NOTHING * band.value:
        found.append(
            f"the slip jump cannot be identified from this window: any value below "
            f"{jump.high:.3g} fits as well"
        )
    elif jump.high - jump.low > _VAGUE * jump.value:
        found.append(
            f"the slip jump is vague in this window: anything from {jump.low:.3g} to "
            f"{jump.high:.3g} fits about as well"
        )
    return tuple(found)


def dead_time_bound(dead_time: int, longest: int) -> tuple[str, ...]:
    """A sentence where the dead time (samples) is the longest one that was tried."""
    if dead_time < longest:
        return ()
    return (
        f"the dead time ends at {longest} samples, the longest that is tried: the real one may be "
        f"longer; record the loop at a longer period",
    )
