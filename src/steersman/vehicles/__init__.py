"""Vehicles: the declaration of one, and a file for each car or group of cars."""

from steersman.vehicles.base import KMH, LONGEST_STEP, Vehicle
from steersman.vehicles.bmw_320i import Bmw320i
from steersman.vehicles.carla import CarlaMkz2020, CarlaModel3, CarlaModel3V1
from steersman.vehicles.file import VehicleFile
from steersman.vehicles.vw_t7 import VwT7

__all__ = [
    "KMH",
    "LONGEST_STEP",
    "Bmw320i",
    "CarlaMkz2020",
    "CarlaModel3",
    "CarlaModel3V1",
    "Vehicle",
    "VehicleFile",
    "VwT7",
]
