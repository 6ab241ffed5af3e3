"""One explanation of a window: valve, process, nuisances and noise, fitted and made likely or not.

Costs only. What to try comes from `search`, which explanation holds is decided in `evidence`.
"""
