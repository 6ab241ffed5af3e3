"""The kinds of loop in the report family: what each has that the others need not."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["KINDS", "Kind"]

ALL_LAWS = ("he", "kano", "sliding", "karnopp", "lugre")
SIMPLE_LAWS = ("he", "kano", "sliding")


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind: its process, its load, its valve's laws, and whether it comes healthy or sticky."""

    name: str
    plant: str = "any"
    """"any", "flow", "level", "slow" or "resonant"."""
    load: str | None = None
    """Outside load beside the background, or none in particular."""
    laws: tuple[str, ...] = ALL_LAWS
    second: bool = False
    healthy: bool = True
    sticky: bool = True


def _law(name: str) -> Kind:
    return Kind(name, laws=(name,), healthy=False)


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("pi"),
        Kind("integrating", plant="level"),
        Kind("cascade", plant="flow", second=True, laws=SIMPLE_LAWS),
        Kind("interacting", plant="slow", second=True, laws=SIMPLE_LAWS),
        Kind("sine", load="sine"),
        Kind("triangle", load="triangle"),
        Kind("sines", load="sines"),
        Kind("load-steps", load="load-steps"),
        Kind("ramps", load="ramps"),
        Kind("drift", load="drift"),
        Kind("saturation", load="sine"),
        Kind("curved"),
        Kind("quantised"),
        Kind("held"),
        Kind("interpolated"),
        Kind("decimated", plant="slow", laws=SIMPLE_LAWS),
        Kind("missing"),
        Kind("spikes"),
        Kind("frozen"),
        Kind("noisy-op"),
        Kind("sensor-lag"),
        Kind("oscillatory", plant="resonant"),
        Kind("few-strokes"),
        Kind("pure-slip", laws=SIMPLE_LAWS, healthy=False),
        Kind("dead-band", laws=SIMPLE_LAWS, healthy=False),
        *(_law(name) for name in ALL_LAWS),
        Kind("tight-tuning", sticky=False),
        Kind("setpoint-steps"),
    )
}
"""All kinds by name."""
