import pytest

from fdm.exchange.placement.trial import GAIN, PAIRS, WINDOW_MAX_NS, Trial

MS = 1_000_000


class Run:
    """Sim time that passes at one rate in the first way and at another in the second."""

    def __init__(self, first, second):
        self.trial, self.rates, self.sim_ns, self.wall_ns = Trial(), (first, second), 0, 0
        self.first_ms = self.second_ms = 0

    def on(self, wall_ms, held=False):
        for _ in range(wall_ms):
            self.wall_ns += MS
            self.sim_ns += 0 if held else int(self.rates[self.trial.second] * MS)
            self.first_ms += not self.trial.second
            self.second_ms += self.trial.second
            self.trial.at(self.sim_ns, self.wall_ns)


@pytest.mark.parametrize(
    ("gain", "takes"), [(0.5, False), (1.0, False), (GAIN * 0.97, False), (GAIN * 1.03, True)]
)
def test_the_second_way_is_taken_where_it_pays_clearly(gain, takes):
    run = Run(5.0, 5.0 * gain)
    run.on(2000)
    assert run.trial.done
    assert run.trial.second is takes
    before = run.trial.second
    run.rates = (1.0, 100.0) if not takes else (100.0, 1.0)
    run.on(2000)
    assert run.trial.second is before, "it decided again"


def test_both_ways_get_the_same_time():
    run = Run(5.0, 5.0)
    while not run.trial.done:
        run.on(1)
    assert run.first_ms == pytest.approx(run.second_ms, rel=0.1)
    assert run.wall_ns < 2 * PAIRS * 130 * MS


def test_a_measure_that_was_held_up_is_taken_again():
    run = Run(5.0, 10.0)
    for _ in range(40):
        run.on(50)
        run.sim_ns += 1
        run.wall_ns += 2 * WINDOW_MAX_NS  # a pause
    assert not run.trial.done
    run.on(4000)
    assert run.trial.done
    assert run.trial.second


def test_a_measure_that_was_broken_off_does_not_count():
    run = Run(5.0, 10.0)
    run.on(50)
    run.trial.restart()
    run.sim_ns += 10**12
    run.on(3000)
    assert run.trial.second


def test_a_gain_that_comes_and_goes_is_none():
    run = Run(5.0, 5.0)
    pair = 0
    while not run.trial.done:
        run.rates = (5.0, 8.0 if pair % 3 else 4.0)
        before = run.trial.second
        run.on(1)
        pair += before and not run.trial.second
    assert not run.trial.second
