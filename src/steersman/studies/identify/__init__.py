"""Identification: the vehicle whose figures explain a recording, and how sure they are."""
