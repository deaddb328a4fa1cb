"""Trained policies that are part of the package."""
