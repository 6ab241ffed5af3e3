"""Loops that the compensator's settings are chosen on; what is reported comes from
`benchmarks.apart`, whose plants, valves and controllers are others. No product code lives here.
"""
