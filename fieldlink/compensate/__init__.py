"""The compensator at work beside a real PLC.

Nothing here identifies a valve: the model comes from the parameter block alone.
"""
