"""What no running edge box needs: the simulated PLC, FMU plants, rehearsals and the demo.

Nothing of the daemon, its links or its store may import from here.
"""
