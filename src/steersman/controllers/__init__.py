"""Lateral controllers: each a frozen configuration with explicit state."""
