"""A small world to test the mission in: UA fly straight to their waypoints, powers follow closed forms written here.

Nothing of the code under test, nor of lostlink's channel, computes a power or a draw: log-distance from 1 m of free
space, shadowing as an exact Gaussian process along the very track (each value drawn given all before), Rician fading
as a complex normal about a constant.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from localisation.localiser import Localiser
from localisation.model import Spread
from numpy.typing import NDArray

Floats = NDArray[np.float64]
CARRIER_HZ, EXPONENT, SIGMA_DB, DECORRELATION_M, K_DB, STEP_DB = 433.92e6, 2.2, 3.0, 25.0, 12.0, 0.5
AT_1_M_DB = 20.0 * math.log10(4.0 * math.pi * CARRIER_HZ / 299_792_458.0)
_K = 10.0 ** (K_DB / 10.0)
FADING_DB = (-0.26572, 1.56929)
"""Mean and sigma of 10 log10 of Rician power at K = 12 dB, by numerical integration of its density."""
SPREAD = Spread(SIGMA_DB, DECORRELATION_M, math.hypot(FADING_DB[1], STEP_DB / math.sqrt(12.0)), power_db=3.0)


def mean_power(emitters_ned_m: Floats, places_ned_m: Floats) -> Floats:
    """Mean reading of an emitter of 0 dBm."""
    distance = np.sqrt(np.sum((emitters_ned_m - places_ned_m) ** 2, axis=-1))
    return FADING_DB[0] - AT_1_M_DB - 10.0 * EXPONENT * np.log10(np.maximum(distance, 1.0))


def readings_dbm(
    places_ned_m: Floats,
    emitter_ned_m: Floats,
    power_dbm: float,
    shadowing_db: Floats,
    rng: np.random.Generator,
) -> Floats:
    """Readings of given shadowing, shape (n,)."""
    i, q = rng.normal(size=(2, len(places_ned_m))) * math.sqrt(0.5 / (_K + 1.0))
    fading_db = 10.0 * np.log10((math.sqrt(_K / (_K + 1.0)) + i) ** 2 + q**2)
    distance_m = np.linalg.norm(places_ned_m - emitter_ned_m, axis=-1)
    signal_dbm = power_dbm - AT_1_M_DB - 10.0 * EXPONENT * np.log10(distance_m)
    return np.round((signal_dbm + shadowing_db + fading_db) / STEP_DB) * STEP_DB


def shadowing_of(places_ned_m: Floats, rng: np.random.Generator) -> Floats:
    """Shadowing along a track that is known beforehand, dB, shape (n,)."""
    away = np.linalg.norm(places_ned_m[:, None] - places_ned_m[None], axis=-1)
    covariance = SIGMA_DB**2 * np.exp(-away / DECORRELATION_M) + 1e-9 * np.eye(len(away))
    return np.linalg.cholesky(covariance) @ rng.normal(size=len(away))


@dataclass
class Sensor:
    """Draws the readings of one UA of one emitter, along a track that nobody knows beforehand."""

    emitter_ned_m: Floats
    power_dbm: float
    rng: np.random.Generator
    places: list[Floats] = field(default_factory=list)
    shadowing: list[float] = field(default_factory=list)

    def read(self, place_ned_m: Floats) -> float:
        """One reading, dBm."""
        shadowing_db = np.array([self.shade(place_ned_m)])
        [power_dbm] = readings_dbm(
            place_ned_m[None], self.emitter_ned_m, self.power_dbm, shadowing_db, self.rng
        )
        return float(power_dbm)

    def shade(self, place_ned_m: Floats) -> float:
        """Shadowing here given all that was drawn before, dB."""
        mean, variance = 0.0, SIGMA_DB**2
        if self.places:
            known = np.array(self.places)
            here = np.linalg.norm(known - place_ned_m, axis=-1) < 1e-6
            if np.any(here):
                return self.shadowing[int(np.argmax(here))]
            away = np.linalg.norm(known[:, None] - known[None], axis=-1)
            cross = SIGMA_DB**2 * np.exp(-np.linalg.norm(known - place_ned_m, axis=-1) / DECORRELATION_M)
            weights = np.linalg.solve(SIGMA_DB**2 * np.exp(-away / DECORRELATION_M), cross)
            mean, variance = float(weights @ self.shadowing), variance - float(weights @ cross)
        value = mean + math.sqrt(max(variance, 0.0)) * self.rng.normal()
        self.places.append(place_ned_m)
        self.shadowing.append(value)
        return value


@dataclass
class Flyer:
    """One UA: where it is and what it knows."""

    localiser: Localiser
    place_m: Floats
    sensor: Sensor
    course_rad: float = 0.0
    numbers: int = 0


def fly(
    flyers: dict[str, Flyer],
    until_s: int,
    delivery: Callable[[float], float],
    rng: np.random.Generator,
    *,
    begin_s: int = 20,
    replan_s: int = 5,
    look: Callable[[int], None] = lambda second: None,
) -> None:
    """Fly from ``begin_s`` on, in steps of a second: read twice, tell, plan, go on."""
    targets: dict[str, Floats] = {}
    for second in range(begin_s, until_s + 1):
        for node, flyer in flyers.items():
            message = flyer.localiser.message()
            for other, hearer in flyers.items():
                away = float(np.linalg.norm(flyer.place_m - hearer.place_m))
                if other != node and rng.random() < delivery(away):
                    hearer.localiser.received(node, message)
        look(second)
        for node, flyer in flyers.items():
            settings = flyer.localiser.settings.planner
            if (second - begin_s) % replan_s == 0:
                way = flyer.localiser.plan(second * 10**9, flyer.place_m, flyer.course_rad)
                targets[node] = way.places_m[1]
            for half in range(2):
                towards = targets[node] - flyer.place_m
                reach = min(float(np.linalg.norm(towards)), settings.speed_mps * 0.5)
                flyer.place_m = flyer.place_m + towards / max(float(np.linalg.norm(towards)), 1e-9) * reach
                flyer.course_rad = float(math.atan2(towards[1], towards[0]))
                ned = np.array([*flyer.place_m, -settings.altitude_m])
                flyer.numbers += 1
                stamp = second * 10**9 + half * 5 * 10**8
                flyer.localiser.measured(flyer.numbers, "beacon", stamp, ned, flyer.sensor.read(ned))
