from fdm.air.wind import WindConfig
from fdm.clock.member import Member
from fdm.exchange.hosted_aircraft import ExchangedAircraft
from fdm.model.air_point import AirPoint

MS = 1_000_000
FRAME = (18458, 400, 0, *[1500] * 16)


class Model:
    """A flight model that notes the wind that it is given at each of its frames."""

    def __init__(self):
        self.winds, self.asked = [], 0

    def sense(self):
        return (0.0,) * 16

    def step(self, fields, rate_hz):
        pass

    def air_point(self, sim_time_ns):
        self.asked += 1
        return AirPoint(sim_time_ns, 47.0, 8.0, 400.0, 0.0, (0.0, 0.0, 0.0))

    def set_wind(self, wind_ned_mps):
        self.winds.append(wind_ned_mps)


def flown(frames=20, **parts):
    """A UA after some frames of 5 ms, and the models that it had."""
    models = []

    def build():
        models.append(Model())
        return models[-1]

    member = Member(0)
    aircraft = ExchangedAircraft(
        member, build, lambda numbers: numbers, WindConfig.model_validate(parts).build(seed=1, ua_id=0)
    )
    aircraft.set_fleet_time(0)
    for _ in range(2):
        for _ in range(frames):
            aircraft.asked(FRAME, "", 0)
            aircraft.step()
            member.sim_time_ns += 5 * MS
        aircraft.reset()
        aircraft.set_fleet_time(member.sim_time_ns)
    return models


def test_a_wind_that_never_changes_is_felt_once_after_each_boot():
    first, second, _ = flown(constant={"speed_mps": 8, "from_deg": 180, "up_mps": 1})
    for model in (first, second):
        ((north, east, down),) = model.winds
        assert (round(north, 9), round(east, 9), down) == (8, 0, -1)
    assert [model.winds for model in flown()[:2]] == [[(0.0, 0.0, 0.0)]] * 2


def test_a_wind_that_changes_is_felt_every_10_ms():
    gust = {"speed_mps": 6, "start_s": 0, "rise_s": 1}
    first, second, _ = flown(gusts=[gust])
    assert len(first.winds) == len(second.winds) == 10
    assert len(set(first.winds)) == 10
