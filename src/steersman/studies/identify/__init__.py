"""Identification: the vehicle whose figures explain a recording, with confidence intervals."""
