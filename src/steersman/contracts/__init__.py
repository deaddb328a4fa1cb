"""Checks that every component of a family has to pass, for the authors of plug-ins too."""
