"""The compensator at work beside a real PLC.

Its control law is `compensator`'s; registers, clock and memory are handled here.
"""
