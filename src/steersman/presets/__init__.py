"""Shipped training presets."""
