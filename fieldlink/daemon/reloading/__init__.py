"""A changed site file: noticed, compared with the one in force, taken over device by device.

What a loop hands over to its successor is decided in the loop itself.
"""
