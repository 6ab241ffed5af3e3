"""Where batches are judged: in processes of this machine, or on a Dask cluster.

An engine takes batches and gives answers in any order; it knows no file, no plan and no table.
"""
