"""The names in the address space, and what the companion specifications say about them.

`DI` and `PADIM` are OPC 10000-100 (Devices) and OPC 30081 (Process Automation Devices). Their names
are used where they fit: ``DeviceSet``, ``DeviceHealth``, ``AssetId``, ``ComponentName``, and
``SignalSet`` with ``SignalTag`` and ``AnalogSignal``. Their types are not used: a PADIMType needs
manufacturer, model and serial number of the valve, which a site file does not hold.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "DEVICE_HEALTH",
    "DEVICE_HEALTH_NAMES",
    "DEVICE_SET",
    "DEVICE_VARIABLES",
    "DI",
    "HEALTH_STRINGS",
    "LOOP_VARIABLES",
    "PADIM",
    "Entry",
]

DI = "http://opcfoundation.org/UA/DI/"
PADIM = "http://opcfoundation.org/UA/PADIM/"

DEVICE_SET, DEVICE_HEALTH, HEALTH_STRINGS = 5001, 6244, 6450
"""Numeric node ids in the namespace DI: DeviceSet, DeviceHealthEnumeration, its EnumStrings."""

DEVICE_HEALTH_NAMES = ("NORMAL", "FAILURE", "CHECK_FUNCTION", "OFF_SPEC", "MAINTENANCE_REQUIRED")
"""DeviceHealthEnumeration, in the order of its values: the classes of NAMUR NE 107."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A variable.

    Attributes:
        name: its browse name.
        kind: its data type: a built-in type of OPC UA, or ``DeviceHealth``.
        text: its description.
        namespace: of the browse name; our own where it is empty.
        judged: whether its source time is the end of the window that the verdict rests on.
        signal: whether the loop's SignalSet has it too.
    """

    name: str
    kind: str
    text: str
    namespace: str = ""
    judged: bool = False
    signal: bool = False

    @property
    def alias(self) -> tuple[str, ...]:
        """Where the SignalSet has the value: names below the loop."""
        return ("SignalSet", self.name, "AnalogSignal")


_VALVE_HEALTH = (
    "Health of the control valve: MAINTENANCE_REQUIRED when it sticks, NORMAL when it does not; "
    "uncertain when the estimator doubts it, bad while there is no verdict."
)

LOOP_VARIABLES = (
    Entry("AssetId", "String", "Name of the loop in the site file.", DI),
    Entry("DeviceHealth", "DeviceHealth", _VALVE_HEALTH, DI, judged=True),
    Entry(
        "Verdict",
        "String",
        "stiction, no_stiction or not_assessable; bad before the first.",
        judged=True,
    ),
    Entry("Doubtful", "Boolean", "The estimator doubts the verdict.", judged=True),
    Entry("Score", "Double", "Log Bayes factor, sticky over healthy valve, nats.", judged=True),
    Entry("StickBand", "Double", "Stick band S in units of OP.", judged=True, signal=True),
    Entry("StickBandLow", "Double", "Lower bound of the interval of S.", judged=True),
    Entry("StickBandHigh", "Double", "Upper bound of the interval of S.", judged=True),
    Entry(
        "StickBandLimit",
        "Double",
        "Largest S for maintenance, units of OP (report.stick_band_limit).",
    ),
    Entry("SlipJump", "Double", "Slip jump J in units of OP.", judged=True, signal=True),
    Entry("SlipJumpLow", "Double", "Lower bound of the interval of J.", judged=True),
    Entry("SlipJumpHigh", "Double", "Upper bound of the interval of J.", judged=True),
    Entry("Confidence", "Double", "Confidence of the intervals, 0 to 1.", judged=True),
    Entry("TrendPerWeek", "Double", "Change of S in a week, units of OP; bad while unknown."),
    Entry("DaysToLimit", "Double", "Days until S reaches its limit; bad while unknown."),
    Entry("JudgedAt", "DateTime", "End of the window that the verdict rests on."),
    Entry("Message", "String", "The outcome of the newest window, in a sentence."),
    Entry("Compensated", "Boolean", "The PLC's controller uses the model."),
    Entry("BlockState", "String", "What the parameter block in the PLC is doing."),
    Entry("BlockReason", "String", "Why, in a sentence."),
    Entry("BlockSequence", "UInt32", "Number of the block that the PLC has; bad without one."),
    Entry("Device", "String", "Name of the device that the loop is read from."),
    Entry("DataQuality", "Double", "Share of the samples that were read with good values, 0 to 1."),
)
"""The variables of a loop, in the order in which clients see them."""

DEVICE_VARIABLES = (
    Entry("ComponentName", "LocalizedText", "Name of the device in the site file.", DI),
    Entry(
        "DeviceHealth",
        "DeviceHealth",
        "Health of the connection: NORMAL, OFF_SPEC when some tags cannot be read, FAILURE when "
        "the device does not answer.",
        DI,
    ),
    Entry("State", "String", "good, degraded, demoted or closed."),
    Entry("Reason", "String", "The last failure, empty while the state is good."),
    Entry("Address", "String", "Where the device is reached."),
    Entry("Requests", "UInt32", "Requests sent since the daemon began."),
    Entry("MissedSamples", "UInt32", "Samples missed since the daemon began."),
)
"""The variables of a device: a PLC, an OPC UA server, or another source of values."""
