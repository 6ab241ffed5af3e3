"""The compensator at work: studied on simulated plants, and beside a real PLC."""
