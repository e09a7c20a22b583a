"""Real runs read back: decided anew they are what they were, played they say what was published."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import pytest

from bridge.bus.identity.keyring import OBSERVERS
from bridge.bus.keys import Keys
from bridge.bus.messages import encode
from bridge.bus.session import Sample, open_client
from bridge.record.tables.deliveries import DELIVERIES
from lostlink.redecision.redecide import redecide
from lostlink.redecision.rewrite import write_deliveries
from lostlink.replay.player import Player
from tests.integration.bridge.conftest import STILL, Run, StartRun
from tests.warm import run_lostlink

LOCALISE = Path(__file__).parents[4] / "examples" / "localise" / "localise.yaml"
FLYING = STILL.replace(
    "home: {{north_m: 410}}, agent: {{type: still}}",
    "home: {{north_m: 330}}, agent: {{type: out_and_back, altitude_m: 20, distance_m: 120, speed_mps: 12}}",
)
CORRELATED = (
    "{{preset: corrected, transmit_power_dbm: 3, shadowing: {{model: gudmundson, sigma_db: 6, decorrelation_m: 20}}, "
    "fading: {{model: rician, k_db: 3, coherence: doppler}}, bursts: "
    "{{model: gilbert-elliott, mean_good_s: 1.0, mean_bad_s: 0.2, loss_good: 0.0, loss_bad: 0.9}}}}"
)


def decided_again(run: Path, tmp_path: Path, **by: Any) -> bytes:
    result = redecide(run, **by)
    write_deliveries(result, tmp_path)
    return DELIVERIES.parquet_path(tmp_path).read_bytes()


def recorded(run: Run) -> bytes:
    assert run.finish() == 0, run.output.decode()
    return DELIVERIES.parquet_path(run.directory).read_bytes()


@pytest.mark.slow
def test_a_flight_is_decided_the_same_again_and_by_another_radio_as_in_a_run_with_it(
    start_run: StartRun, tmp_path: Path
) -> None:
    """The agents of this scenario take no notice of what they hear: their flight is that of another radio, too."""
    first = start_run(scenario=FLYING.replace("radio: moon2020", f"radio: {CORRELATED}"), duration_s=16.0)
    fates = recorded(first)
    second = start_run(scenario=FLYING, duration_s=16.0)
    others = recorded(second)
    assert fates != others
    assert decided_again(first.directory, tmp_path / "a") == fates
    assert decided_again(first.directory, tmp_path / "b", radio="moon2020") == others
    assert (
        decided_again(second.directory, tmp_path / "c", radio=redecide(first.directory).scenario.radio)
        == fates
    )


JAMMED = (
    STILL.replace("radio: moon2020", "radio: wifi-2.4").rstrip()
    + """
  - {{id: jammer, kind: emitter, place: {{north_m: 380, east_m: 40, height_m: 2}}, frequency_hz: 2.437e+9,
     power_dbm: 10, duty: 0.4}}
"""
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("medium", "cause"), [("csma, standard: 11g", "interfered"), ("ideal", "channel_erasure")]
)
def test_emitters_that_disturb_packets_do_so_again(
    start_run: StartRun, tmp_path: Path, medium: str, cause: str
) -> None:
    radio = f"radio: {{{{preset: wifi-2.4, medium: {{{{model: {medium}}}}}}}}}"
    run = start_run(scenario=JAMMED.replace("radio: wifi-2.4", radio), duration_s=6.0)
    fates = recorded(run)
    summary = json.loads((run.directory / "summary.json").read_text())
    assert any(link["lost"].get(cause) for link in summary["links"])
    assert decided_again(run.directory, tmp_path) == fates


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["separation", str(LOCALISE)])
def test_every_scenario_that_ships_is_decided_the_same_again(
    scenario: str, tmp_path: Path, free_slot: Any
) -> None:
    is_the_same_again(scenario, tmp_path, free_slot(2))


@pytest.mark.slow
@pytest.mark.ardupilot
def test_a_flight_with_real_autopilots_is_decided_the_same_again(
    tmp_path: Path, free_slot: Any, arducopter: Path, arduplane: Path
) -> None:
    assert arducopter.exists() == arduplane.exists()
    is_the_same_again("mixed", tmp_path, free_slot(2))


def is_the_same_again(scenario: str, tmp_path: Path, slot: int) -> None:
    options = (
        "--duration",
        "60",
        "--speed",
        "max",
        "--first-slot",
        str(slot),
        "--zenoh-port",
        "0",
        "--quiet",
    )
    command = ["run", scenario, "--out", str(tmp_path / "runs"), *options]
    assert run_lostlink(*command, timeout=280).returncode == 0
    (run,) = (tmp_path / "runs").iterdir()
    assert decided_again(run, tmp_path / "again") == DELIVERIES.parquet_path(run).read_bytes()
    assert redecide(run).comparison.fates > 1000


@pytest.mark.slow
def test_a_killed_run_is_decided_and_played_as_far_as_it_goes(start_run: StartRun) -> None:
    run = start_run(speed="4")
    run.wait_for(" in the last ")  # the second line of progress, after ten seconds
    processes = run.children()
    run.process.kill()
    run.process.wait(10.0)
    for process in processes:
        process.wait(10.0)
    comparison = redecide(run.directory).comparison
    assert comparison.changed == 0
    assert comparison.fates > 250
    player = Player.open(run.directory)
    assert player.end_ns > 8_000_000_000
    assert player.seek(player.end_ns).states()["1"].mav_id == 2


class Published:
    """What an observer of a run was sent."""

    def __init__(self) -> None:
        self.samples: dict[str, list[Sample]] = {}
        self.enough = threading.Event()

    def take(self, sample: Sample) -> None:
        key = str(sample.key_expr)
        self.samples.setdefault(key, []).append(sample)
        if key.endswith("tick/links") and len(self.samples[key]) == 20:
            self.enough.set()

    def payloads(self, key: str) -> set[bytes]:
        return {sample.payload.to_bytes() for sample in self.samples.get(key, ())}


@pytest.mark.slow
def test_a_record_is_played_as_the_run_published_it(start_run: StartRun) -> None:
    run = start_run(scenario=FLYING, duration_s=16.0, speed="4")
    run.wait_for("sim time")
    published = Published()
    with open_client(run.endpoint, OBSERVERS) as session:
        session.subscribe("lostlink/**", published.take)
        assert published.enough.wait(60.0)
        assert run.finish() == 0, run.output.decode()
    keys = Keys(run.directory.name)
    played: dict[str, set[bytes]] = {}
    received: set[tuple[str, bytes, bytes]] = set()
    for moment in Player.open(run.directory).moments():
        messages = [(keys.tick("truths"), moment.truths()), (keys.tick("fates"), moment.fates())]
        messages += [(keys.truth(node), truth) for node, truth in moment.truth().items()]
        messages += [(keys.tick("communication"), moment.communication())]
        messages += [(keys.comm_status(s.header.frame_id), s) for s in moment.statuses()]
        states = moment.states().items()
        messages += [(keys.state(node), s) for node, s in states if s.header.stamp.ns == moment.sim_time_ns]
        messages += [(keys.tick("links"), moment.links())] if moment.links_are_due else []
        for key, message in messages:
            played.setdefault(key, set()).add(encode(message))
        received |= {(keys.rx(p.rx, p.tx, p.channel), p.attachment, p.payload) for p in moment.received()}
    for key, expected in played.items():
        was = published.payloads(key)
        assert len(was) > (15 if key.endswith("links") else 40), key
        assert was <= expected, key
    heard = {
        (key, sample.attachment.to_bytes(), sample.payload.to_bytes())
        for key, samples in published.samples.items()
        for sample in samples
        if "/rx/" in key and sample.attachment is not None
    }
    assert len(heard) > 100
    assert heard <= received
