"""Recordings in the formats of ROS 2: episodes as MCAP, and the recordings of others. docs/logs.md.

``read(file)`` gives what a car did as columns, of any recorder. ``write.write_episode`` and
``restore.read_episode`` keep a run of our own. All of it needs the extra ``logs``.
"""

from steersman.logs.read import COLUMNS, MotionLog, read

__all__ = ["COLUMNS", "MotionLog", "read"]
