"""Windows into findings: in processes of their own, bounded in time and memory.

How a window is judged is `estimator`'s; what may be written of it is `writeback`'s.
"""
