"""The simulated PLC that hosts plants and their controllers."""
