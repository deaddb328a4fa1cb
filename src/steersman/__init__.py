"""Steersman trains, tunes, compares and delivers steering controllers."""

import gymnasium

__version__ = "0.1.0"

gymnasium.register(
    id="steersman/PathFollowing-v0", entry_point="steersman.learning.env:PathFollowingEnv"
)
