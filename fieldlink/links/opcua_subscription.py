"""A subscription at an OPC UA server: values of some nodes, reported when they change.

asyncua's own hides intervals that the server makes longer, which decide how old a value may be.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from asyncua import ua

from fieldlink.links.opcua_reports import Reports
from fieldlink.links.opcua_values import NOT_THERE

__all__ = ["begin_reports"]

FEWEST_ROUNDS = 100
"""Fewest publishing intervals for which a server keeps a subscription that nothing is fetched of:
a short period must not make it forget one within a pause of the network."""


async def begin_reports(
    session: Any,
    nodes: Mapping[str, Any],
    reports: Reports,
    milliseconds: float,
    life: float,
    take: Callable[[Any], None],
) -> None:
    """Begin a subscription.

    Args:
        session: of asyncua, connected.
        nodes: their ids, by the names that ``reports`` knows them by.
        reports: told which intervals the server grants, and which nodes it refuses.
        milliseconds: sampling and publishing interval that is asked for.
        life: milliseconds for which the server keeps a subscription that nothing is fetched of.
        take: called with every message of the server.

    Raises:
        UaError: the server refuses the subscription.
    """
    settings = ua.CreateSubscriptionParameters(
        RequestedPublishingInterval=milliseconds,
        RequestedLifetimeCount=max(FEWEST_ROUNDS, round(life / milliseconds)),
        RequestedMaxKeepAliveCount=1,
        PublishingEnabled=True,
    )
    begun = await session.create_subscription(settings, take)
    granted: Any = begun
    if begun.RevisedMaxKeepAliveCount > 1:
        # A sign of life every so many rounds: the rounds have to be shorter for it.
        rounds = int(begun.RevisedMaxKeepAliveCount)
        granted = await session.update_subscription(
            ua.ModifySubscriptionParameters(
                SubscriptionId=begun.SubscriptionId,
                RequestedPublishingInterval=milliseconds / rounds,
                RequestedLifetimeCount=rounds * settings.RequestedLifetimeCount,
                RequestedMaxKeepAliveCount=1,
            )
        )
    reports.grant_publishing(granted)
    items = ua.CreateMonitoredItemsParameters(
        SubscriptionId=begun.SubscriptionId, TimestampsToReturn=ua.TimestampsToReturn.Both
    )
    for handle, (name, node) in enumerate(nodes.items()):
        items.ItemsToCreate.append(_item(handle, node, milliseconds))
        reports.expect(handle, name)
    for name, item in zip(nodes, await session.create_monitored_items(items), strict=True):
        if item.StatusCode.is_good():
            reports.grant_sampling(item.RevisedSamplingInterval)
        else:
            status = str(item.StatusCode.name)
            reports.refuse(name, status, refused=status in NOT_THERE)


def _item(handle: int, node: Any, milliseconds: float) -> Any:
    """Return the request to sample a node's value; of several samples the newest counts."""
    return ua.MonitoredItemCreateRequest(
        ItemToMonitor=ua.ReadValueId(NodeId=node, AttributeId=ua.AttributeIds.Value),
        MonitoringMode=ua.MonitoringMode.Reporting,
        RequestedParameters=ua.MonitoringParameters(
            ClientHandle=handle, SamplingInterval=milliseconds, QueueSize=1, DiscardOldest=True
        ),
    )
