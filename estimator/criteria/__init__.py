"""What ``criterion`` names: how valve, process and intervals are estimated once the verdict stands.

One class a criterion and one line in `registry`; the verdict itself is that of `evidence`.
"""
