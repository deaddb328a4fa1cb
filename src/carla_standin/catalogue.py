"""CARLA's vehicles by name, and which of ours drives behind each."""

from __future__ import annotations

from typing import NamedTuple

import steersman as sm
from carla_standin.wire import warn_once

MODEL3 = "vehicle.tesla.model3"
MKZ = "vehicle.lincoln.mkz_2020"


class VehicleBlueprint(NamedTuple):
    """A vehicle that can be spawned, and what our parameters do not say of it."""

    vehicle: sm.Vehicle
    offset: float
    """Centre of mass ahead of the actor's origin [m]."""
    below: float
    """Centre of mass above the actor's origin [m]; negative: below."""
    height: float
    """Of the body [m]."""
    radius: float
    """Of the wheels [m]."""
    generation: int
    """Of the asset, as CARLA's catalogue counts."""
    special: str
    """Special type there."""
    fittings: bool = False
    """Whether it has lights and doors there; here it has neither."""
    base: str = "car"
    """Base type there."""
    wheels: int = 4
    """Their number there; behind a name with two drives a car that is as narrow as that."""

    @property
    def extent(self) -> tuple[float, float, float]:
        """Half of its box: along, across, up [m]."""
        length, width = self.vehicle.body_length, self.vehicle.width
        if self.wheels == _TWO:
            length, width = _RIDER
        return 0.5 * length, 0.5 * width, 0.5 * self.height


class _Named(NamedTuple):
    """A name of CARLA's whose vehicle is not here."""

    nearest: str
    generation: int
    special: str = ""
    base: str = "car"
    wheels: int = 4


_TWO = 2
# Length and width of those with two wheels [m], and their height with a rider: about those of such
# things in general.
_RIDER = (2.0, 0.7)
_RIDDEN = 1.7
_SMALL, _LARGE, _TESLA, _SALOON = "bmw_320i", "vw_t7", "carla_model3", "carla_mkz2020"
# Names, generations and types: https://carla.readthedocs.io/en/0.9.16/catalogue_vehicles/. The
# nearest is chosen by size: small cars, saloons (those with batteries apart), vans and lorries.
_NAMED = {
    "vehicle.audi.a2": _Named(_SMALL, 1),
    "vehicle.audi.etron": _Named(_TESLA, 1, "electric"),
    "vehicle.audi.tt": _Named(_SMALL, 1),
    "vehicle.bh.crossbike": _Named(_SMALL, 1, base="bicycle", wheels=_TWO),
    "vehicle.bmw.grandtourer": _Named(_SMALL, 1),
    "vehicle.carlamotors.carlacola": _Named(_LARGE, 1, base="truck"),
    "vehicle.carlamotors.european_hgv": _Named(_LARGE, 2, base="truck"),
    "vehicle.carlamotors.firetruck": _Named(_LARGE, 2, "emergency", "truck"),
    "vehicle.chevrolet.impala": _Named(_SALOON, 1),
    "vehicle.citroen.c3": _Named(_SMALL, 1),
    "vehicle.diamondback.century": _Named(_SMALL, 1, base="bicycle", wheels=_TWO),
    "vehicle.dodge.charger_2020": _Named(_SALOON, 2),
    "vehicle.dodge.charger_police": _Named(_SALOON, 1, "emergency"),
    "vehicle.dodge.charger_police_2020": _Named(_SALOON, 2, "emergency"),
    "vehicle.ford.ambulance": _Named(_LARGE, 2, "emergency", "van"),
    "vehicle.ford.crown": _Named(_SALOON, 2, "taxi"),
    "vehicle.ford.mustang": _Named(_SALOON, 1),
    "vehicle.gazelle.omafiets": _Named(_SMALL, 1, base="bicycle", wheels=_TWO),
    "vehicle.harley-davidson.low_rider": _Named(_SMALL, 1, base="motorcycle", wheels=_TWO),
    "vehicle.jeep.wrangler_rubicon": _Named(_SMALL, 1),
    "vehicle.kawasaki.ninja": _Named(_SMALL, 1, base="motorcycle", wheels=_TWO),
    "vehicle.lincoln.mkz_2017": _Named(_SALOON, 1),
    "vehicle.mercedes.coupe": _Named(_SALOON, 1),
    "vehicle.mercedes.coupe_2020": _Named(_SALOON, 2),
    "vehicle.mercedes.sprinter": _Named(_LARGE, 2, base="van"),
    "vehicle.micro.microlino": _Named(_SMALL, 1, "electric"),
    "vehicle.mini.cooper_s": _Named(_SMALL, 1),
    "vehicle.mini.cooper_s_2021": _Named(_SMALL, 2),
    "vehicle.mitsubishi.fusorosa": _Named(_LARGE, 2, base="bus"),
    "vehicle.nissan.micra": _Named(_SMALL, 1),
    "vehicle.nissan.patrol": _Named(_SALOON, 1),
    "vehicle.nissan.patrol_2021": _Named(_SALOON, 2),
    "vehicle.seat.leon": _Named(_SMALL, 1),
    "vehicle.tesla.cybertruck": _Named(_LARGE, 1, "electric", "truck"),
    "vehicle.toyota.prius": _Named(_SMALL, 1),
    "vehicle.vespa.zx125": _Named(_SMALL, 1, base="motorcycle", wheels=_TWO),
    "vehicle.volkswagen.t2": _Named(_LARGE, 1, base="van"),
    "vehicle.volkswagen.t2_2021": _Named(_LARGE, 2, base="van"),
    "vehicle.yamaha.yzf": _Named(_SMALL, 1, base="motorcycle", wheels=_TWO),
}
# Height of the body and radius of the wheels [m] of the two that are not CARLA's: those of the
# BMW 320i of 2005 with 195/65 tyres and of the T7 Multivan, rounded.
_BODIES = {_SMALL: (1.42, 0.34), _LARGE: (1.9, 0.35)}


def models(model3: sm.Vehicle) -> dict[str, VehicleBlueprint]:
    """The vehicles by blueprint; ``model3`` is what drives behind the Model 3's name.

    Offsets, heights and radii of the Model 3 and the MKZ: CARLA's blueprints; the MKZ's body is
    taken to be the Model 3's. The origins of the others are half-way between their axles.
    """
    found = {
        MODEL3: VehicleBlueprint(model3, 0.45, -0.3, 1.49, 0.37, 1, "electric"),
        MKZ: VehicleBlueprint(shipped(_SALOON), 0.6, -0.3, 1.49, 0.37, 2, "", fittings=True),
    }
    ours = {
        _TESLA: found[MODEL3]._replace(vehicle=shipped(_TESLA)),
        _SALOON: found[MKZ]._replace(fittings=False),
    }
    for title, (height, radius) in _BODIES.items():
        car = shipped(title)
        middle = 0.5 * (car.l_r - car.l_f)
        ours[title] = VehicleBlueprint(car, middle, -0.3, height, radius, 1, "")
    for name, said in _NAMED.items():
        model = ours[said.nearest]
        found[name] = model._replace(
            generation=said.generation, special=said.special, base=said.base, wheels=said.wheels
        )
        if said.wheels == _TWO:
            found[name] = found[name]._replace(height=_RIDDEN)
    return found


def shipped(name: str) -> sm.Vehicle:
    """One of the package's vehicles."""
    found = sm.make("vehicle", name)
    assert isinstance(found, sm.Vehicle)
    return found


def default_models() -> dict[str, VehicleBlueprint]:
    """The vehicles as they are shipped."""
    return models(shipped(_TESLA))


def note(name: str) -> None:
    """Log, once, that another vehicle drives behind this name, if one does."""
    if name in _NAMED:
        warn_once(f"stand-in: {name} is not here; {_NAMED[name].nearest}, the nearest, drives")
