"""What a site file says about the daemon itself, as the settings of the daemon's parts."""

from __future__ import annotations

from fieldlink.daemon.estimation.pool import PoolSettings
from fieldlink.site import Site
from fieldlink.store import Retention

__all__ = ["pool_settings_of", "retention_of"]


def retention_of(site: Site) -> Retention:
    """Return how long the historian keeps what."""
    wanted = site.historian
    return Retention(
        samples_days=wanted.retention_days,
        average_minutes=wanted.average_minutes,
        averages_days=wanted.averages_days,
        max_bytes=round(1e6 * wanted.max_megabytes),
    )


def pool_settings_of(site: Site) -> PoolSettings:
    """Return the size and the bounds of the estimator's processes."""
    wanted = site.estimation
    default = PoolSettings()
    return PoolSettings(
        workers=wanted.workers or default.workers,
        limit=wanted.window_seconds,
        memory=round(1e6 * wanted.memory_megabytes),
    )
