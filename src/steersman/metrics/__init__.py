"""Figures that are measured of a drive: the registered family ``metric``."""
