"""Windows into findings: in processes of their own, bounded in time and memory.

Nothing here knows a device or a block; the estimator is imported in the processes only.
"""
