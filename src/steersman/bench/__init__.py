"""Measuring controllers: metrics of a run, scenarios, statistics."""
