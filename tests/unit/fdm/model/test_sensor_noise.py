import pickle

import numpy as np
import pytest
from pydantic import ValidationError

from fdm.model.sensor_noise import SensorNoise

EXACT = tuple(float(n) for n in range(18))


def measured(noise, count=4000, seed=1, ua_id=0):
    sense = noise.disturb(seed=seed, ua_id=ua_id)(lambda: EXACT)
    return np.array([sense() for _ in range(count)]) - EXACT


def test_without_errors_nothing_changes():
    assert not measured(SensorNoise(), 5).any()


def test_each_sensor_gets_its_own_errors():
    noise = SensorNoise(
        gyro_sigma_radps=0.01,
        gyro_bias_frd_radps=(0.1, 0.0, -0.1),
        accel_sigma_mps2=0.2,
        position_sigma_m=1.5,
        velocity_sigma_mps=0.3,
        airspeed_sigma_mps=0.5,
    )
    errors = measured(noise)
    sigmas = [0.01] * 3 + [0.2] * 3 + [1.5] * 3 + [0.0] * 3 + [0.3] * 3 + [0.5] + [0.0] * 2
    assert errors.std(axis=0) == pytest.approx(sigmas, rel=0.05)
    assert errors.mean(axis=0)[:3] == pytest.approx((0.1, 0.0, -0.1), abs=0.001)


def test_errors_are_keyed_by_seed_and_ua():
    noise = SensorNoise(accel_sigma_mps2=1.0)
    assert (measured(noise, 10) == measured(noise, 10)).all()
    assert (measured(noise, 10) != measured(noise, 10, seed=2))[:, 3:6].all()
    assert (measured(noise, 10) != measured(noise, 10, ua_id=1))[:, 3:6].all()


def test_a_negative_deviation_is_refused():
    with pytest.raises(ValidationError, match="greater than or equal to 0"):
        SensorNoise(gyro_sigma_radps=-1)


def test_it_goes_to_another_process_as_it_is():
    disturb = SensorNoise(accel_sigma_mps2=1.0).disturb(seed=3, ua_id=2)
    sent = pickle.loads(pickle.dumps(disturb))
    assert sent(lambda: EXACT)() == disturb(lambda: EXACT)()
