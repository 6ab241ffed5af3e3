"""The command `fieldlink assess` run as users run it: timed, killed, on a Dask cluster.

What measures one run is here; which runs make a table is `benchmarks.assess_fleet`.
"""
