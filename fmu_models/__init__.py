"""Plants as FMUs: sources, build, catalogue, stepping."""
