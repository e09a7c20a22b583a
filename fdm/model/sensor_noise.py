"""Errors of the sensors beyond those that SITL adds itself: white noise and a constant bias.

SITL adds noise of its own to what it is sent (SIM_ACC1_RND, SIM_GYR1_RND and others); this is for sensors that are
worse, or for an autopilot that adds none. Draws are keyed by seed and UA.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated

from pydantic import Field

from fdm.errors import SensorNoiseError
from fdm.model.truth import Vector
from sitl_configs.config_file import read_model
from sitl_configs.settings import Settings

Sigma = Annotated[float, Field(ge=0)]
Sense = Callable[[], tuple[float, ...]]
_BLOCK = 1024
_COUNT = 16
_GYRO, _ACCEL, _POSITION, _VELOCITY, _AIRSPEED = slice(0, 3), slice(3, 6), slice(6, 9), slice(12, 15), 15


class SensorNoise(Settings):
    """Errors of one UA's sensors; what is not given is free of error.

    Attributes:
        gyro_sigma_radps, accel_sigma_mps2: standard deviation per frame and axis.
        gyro_bias_frd_radps, accel_bias_frd_mps2: constant errors.
        position_sigma_m, velocity_sigma_mps, airspeed_sigma_mps: standard deviation per frame.
    """

    gyro_sigma_radps: Sigma = 0.0
    gyro_bias_frd_radps: Vector = (0.0, 0.0, 0.0)
    accel_sigma_mps2: Sigma = 0.0
    accel_bias_frd_mps2: Vector = (0.0, 0.0, 0.0)
    position_sigma_m: Sigma = 0.0
    velocity_sigma_mps: Sigma = 0.0
    airspeed_sigma_mps: Sigma = 0.0

    def disturb(self, *, seed: int, ua_id: int) -> Callable[[Sense], Sense]:
        """What turns the exact numbers of a frame into measured ones; attitude and optional sensors stay exact.

        Each boot of the autopilot meets the same errors anew.

        Args:
            seed: of the run.
            ua_id: which UA.
        """
        return partial(_disturbed, self, seed, ua_id)


def _disturbed(noise: SensorNoise, seed: int, ua_id: int, sense: Sense) -> Sense:
    import numpy as np  # late: whoever only reads a scenario does without

    sigmas, biases = np.zeros(_COUNT), np.zeros(_COUNT)
    sigmas[_GYRO], biases[_GYRO] = noise.gyro_sigma_radps, noise.gyro_bias_frd_radps
    sigmas[_ACCEL], biases[_ACCEL] = noise.accel_sigma_mps2, noise.accel_bias_frd_mps2
    sigmas[_POSITION] = noise.position_sigma_m
    sigmas[_VELOCITY] = noise.velocity_sigma_mps
    sigmas[_AIRSPEED] = noise.airspeed_sigma_mps
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, ua_id, 0x5E45])))

    def errors() -> Iterator[list[float]]:
        while True:
            yield from (generator.standard_normal((_BLOCK, _COUNT)) * sigmas + biases).tolist()

    stream = errors()

    def noisy() -> tuple[float, ...]:
        values = sense()
        measured = (value + error for value, error in zip(values, next(stream), strict=False))
        return (*measured, *values[_COUNT:])

    return noisy


def load_sensor_noise(path: str | Path) -> SensorNoise:
    """Load the errors of a UA's sensors from a YAML file with the keys of `SensorNoise`.

    Raises:
        SensorNoiseError: no such file, or it is wrong; the text says where.
    """
    return read_model(Path(path), SensorNoise, SensorNoiseError)
