"""Functional mock-up units: controllers and the simulated car, for co-simulation (FMI 2 and 3)."""
