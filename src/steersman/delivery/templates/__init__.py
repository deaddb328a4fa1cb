"""Texts of a delivery, with ``${words}`` to be filled in."""
