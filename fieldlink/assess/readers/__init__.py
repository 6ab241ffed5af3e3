"""One kind of place a module: each lists its pieces and reads them as windows.

A reader runs in the worker that judges; nothing here may know of engines, tables or the estimator.
"""
