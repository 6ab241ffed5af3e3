"""What no running edge box needs.

Here are the simulated PLC, FMU plants, closed-loop studies, rehearsals and the demo. Nothing of the
daemon, its links or its store may import from here.
"""
