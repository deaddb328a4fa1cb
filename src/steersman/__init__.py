"""Steersman trains, tunes, compares and delivers steering controllers."""

__version__ = "0.1.0"
