"""Interferers that are on in slots: each has a pattern of its own, the same for all radios that hear it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import load_radio

SLOT_NS = 10_000_000
COUNT = 1600
PLAIN = {"shadowing": {"model": "none"}, "fading": {"model": "none"}}
NEAR, OTHER = (0.0, 50.0, -10.0), (0.0, -60.0, -10.0)
Jammer = Mapping[str, object]


def jammer(**changes: object) -> Jammer:
    """One that is on in half of all slots."""
    return {"position_ned_m": NEAR, "power_dbm": 20.0, "duty": 0.5, "slot_s": 0.01} | changes


HIDDEN = jammer(position_ned_m=OTHER, power_dbm=-100.0)
"""So faint that nothing of it is heard."""


def noise_dbm(
    lists: Mapping[str, Sequence[Jammer]], network: str = "", **radio: object
) -> dict[str, NDArray[np.float64]]:
    """Noise at nodes in each of many slots, by the interferers of each one's radio; node `tx` transmits."""
    radios = {
        node: Radio(load_radio("corrected", PLAIN | {"interference": {"interferers": list(own)}} | radio))
        for node, own in {**lists, "tx": ()}.items()
    }
    medium = Medium(radios, seed=3, nodes=list(radios), network=network)
    for place, node in enumerate(radios):
        medium.place(node, (float(place), 0.0, -40.0))
    times_ns = SLOT_NS * np.arange(COUNT)
    medium.send(medium.packets(tx="tx", seq=np.arange(COUNT), sim_time_ns=times_ns, length_bytes=40))
    found = medium.settle()
    noise = (found.received_power_dbm - found.snr_db).reshape(COUNT, len(lists))
    return dict(zip(lists, noise.T, strict=True))


def is_on(lists: Mapping[str, Sequence[Jammer]], network: str = "") -> dict[str, NDArray[np.bool_]]:
    """In which slots each hears one."""
    return {node: noise > -80.0 for node, noise in noise_dbm(lists, network).items()}


def are_independent(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> bool:
    """Whether two of a duty of a half agree in half of all slots: 99.9 % of a binomial."""
    return abs(int((one == other).sum()) - one.size / 2) < 3.29 * np.sqrt(one.size / 4)


@pytest.mark.parametrize(
    "other",
    [
        {"position_ned_m": OTHER},
        {"power_dbm": 21.0},
        {"bandwidth_hz": 2e3},
        {"name": "second"},
        {"frequency_hz": 2.413e9},
        {"slot_s": 0.011},
        {"duty": 0.51},
    ],
)
def test_two_of_them_are_independent_wherever_they_are_listed(other: Jammer) -> None:
    on = is_on({"a": [jammer()], "b": [jammer(**other)]})
    assert abs(int(on["a"].sum()) - COUNT / 2) < 3.29 * np.sqrt(COUNT / 4)
    assert are_independent(on["a"], on["b"])


@pytest.mark.parametrize("name", [{}, {"name": "ap"}])
def test_one_of_them_is_the_same_in_every_radio_list_and_network(name: Jammer) -> None:
    same = jammer(**name)
    on = is_on(
        {"a": [same], "b": [HIDDEN, same], "c": [same, HIDDEN], "d": [same | {"frequency_hz": 2.412e9}]}
    )
    on |= {"mesh": is_on({"a": [HIDDEN, same]}, "mesh")["a"]}
    assert 0 < on["a"].sum() < COUNT
    assert [node for node, slots in on.items() if (slots != on["a"]).any()] == []


def test_by_its_name_it_is_the_same_at_any_power_and_carrier() -> None:
    on = is_on({"a": [jammer(name="ap")], "b": [jammer(name="ap", power_dbm=30.0, frequency_hz=2.413e9)]})
    assert (on["a"] == on["b"]).all()


def test_equal_ones_in_one_list_are_several() -> None:
    """Two that are on in half of the slots each: three quarters have one or both; the second is 3 dB more."""
    noise = noise_dbm({"a": [jammer(), jammer()]})["a"]
    levels_dbm, counts = np.unique(np.round(noise, 2), return_counts=True)
    assert levels_dbm[2] - levels_dbm[1] == pytest.approx(10.0 * np.log10(2.0), abs=0.02)
    assert np.all(np.abs(counts - COUNT * np.array([0.25, 0.5, 0.25])) < 3.29 * np.sqrt(COUNT / 4))


def test_its_shadowing_is_its_own_wherever_it_is_listed() -> None:
    shadowed = {"shadowing": {"model": "normal", "sigma_db": 6.0}}
    always, beside = jammer(duty=1.0), jammer(duty=1.0, position_ned_m=OTHER, power_dbm=-150.0)
    first, second = (noise_dbm({"a": own}, **shadowed)["a"] for own in ([always, beside], [beside, always]))
    assert first == pytest.approx(second, abs=2e-3)
    assert np.std(first) == pytest.approx(6.0, abs=3.29 * 6.0 / np.sqrt(2 * COUNT))
