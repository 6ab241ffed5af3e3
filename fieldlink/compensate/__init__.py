"""The compensator at work beside a real PLC."""
