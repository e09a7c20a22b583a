from aps.callbacks import Callbacks
from aps.vehicle.subscription import Subscription
from aps.vehicle.telemetry import VehicleState


def offered(period_ms, times_ms):
    got = []
    subscription = Subscription(
        lambda state: got.append(state.time_boot_ms), period_ms, lambda _: None, Callbacks()
    )
    for ms in times_ms:
        subscription.offer(VehicleState(sysid=1, time_boot_ms=ms))
    return got


def test_subscription_keeps_its_rate_in_the_autopilots_time():
    assert len(offered(100.0, range(0, 10_000, 30))) == 100
    assert offered(0.0, [1, 2, 2, 3]) == [1, 2, 2, 3]


def test_subscription_goes_on_after_a_gap_and_after_a_reboot():
    assert offered(100.0, [0, 5000, 5010, 5200, 90, 150, 200]) == [0, 5000, 5200, 90, 200]


def test_failing_callback_does_not_reach_the_caller(caplog):
    def fail(_state):
        raise RuntimeError("mine")

    callbacks = Callbacks()
    Subscription(fail, 0.0, lambda _: None, callbacks).offer(VehicleState(sysid=1))
    assert callbacks.errors == 1
    assert "a state callback failed" in caplog.text
