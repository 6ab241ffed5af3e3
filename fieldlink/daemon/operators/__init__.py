"""What operators ask of a daemon: orders on the record, a block withdrawn.

Nothing here writes a register: an order changes what the write-back's rules allow.
"""
