"""Calibration: manoeuvres on any plant, and the vehicle whose figures explain them."""
