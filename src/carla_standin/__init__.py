"""A stand-in for a CARLA server: no GPU, no engine, our simulator behind CARLA's wire protocol.

For tests, teaching and the CI of control clients. Its numbers are those of the embedded simulator,
never CARLA's. docs/carla_standin.md says what it implements.
"""

from carla_standin.catalogue import models
from carla_standin.server import StandinServer, serve

__all__ = ["StandinServer", "models", "serve"]
