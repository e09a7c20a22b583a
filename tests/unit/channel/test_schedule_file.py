"""Schedules of slots from files: what is read, and how mistakes are told."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from channel.access.media import schedule as module
from channel.access.settings.base import Surroundings
from channel.access.settings.tdma import TdmaMedium
from channel.access.world import PlainWorld
from channel.presets import PresetError, radio_from_mapping, radio_to_yaml, seen_from

DOCS = Path(__file__).parents[3] / "docs" / "reference" / "air.md"
MEDIUM_TEXT, SLOTS_TEXT = re.findall(
    r"```yaml\n(.*?)```", DOCS.read_text().partition("## Slots")[2], re.DOTALL
)
"""The example of the docs: a radio, and its slots.yaml."""
MS = 1_000_000


def radio(folder: Path, text: str = SLOTS_TEXT, **changes: Any) -> Any:
    (folder / "slots.yaml").write_text(text)
    mapping = yaml.safe_load(MEDIUM_TEXT)["radio"]
    mapping["medium"] |= changes
    return radio_from_mapping(seen_from(folder, mapping))


def medium(folder: Path, text: str = SLOTS_TEXT, **changes: Any) -> TdmaMedium:
    found = radio(folder, text, **changes).medium
    assert isinstance(found, TdmaMedium)
    return found


def test_the_example_of_the_docs_is_what_it_says(tmp_path: Path) -> None:
    schedule = medium(tmp_path).schedule
    assert schedule is not None
    slots = schedule.by_id
    assert schedule.read_from == str(tmp_path / "slots.yaml")
    assert slots.round_ns == 150 * MS
    assert [(slot.nodes, slot.start_ns // MS, slot.room_ns // MS) for slot in slots.slots] == [
        (("0",), 0, 48),
        (("g1",), 50, 48),
        (("g2",), 50, 48),
        (("0",), 100, 18),
    ]
    assert [slot.listeners for slot in slots.slots] == [(), ("0",), ("g3",), ()]
    assert [(slot.channel, slot.bit_rate_bps, slot.priority) for slot in slots.slots] == [
        (0, None, None),
        (0, None, None),
        (2, None, None),
        (0, 128_000.0, 5),
    ]


def test_a_radio_keeps_its_slots_when_it_is_written_down(tmp_path: Path) -> None:
    """The file may be gone by then."""
    config = radio(tmp_path)
    (tmp_path / "slots.yaml").unlink()
    assert radio_from_mapping(yaml.safe_load(radio_to_yaml(config))) == config


def test_what_slots_carry(tmp_path: Path) -> None:
    """100 bytes take 12.5 ms at 64 kb/s: 3 go into 48 ms; 6.25 ms at 128 kb/s: 2 into 18. A round is 0.15 s.

    Node 0 has 3 of any class and 2 of class 5, g1 and g2 have 3 each, g3 has none; 400 bytes, 50 ms, fit nowhere, but
    at 128 kb/s, 25 ms, they do not either.
    """
    tdma = medium(tmp_path)
    of_node = {
        (node, priority): tdma.node_capacity_bps(node, ("0", "g1", "g2", "g3"), 100, 64e3, priority)
        for node, priority in (("0", None), ("0", 0), ("0", 5), ("g1", None), ("g2", 0), ("g3", None))
    }
    packets = {("0", None): 5, ("0", 0): 3, ("0", 5): 5, ("g1", None): 3, ("g2", 0): 3, ("g3", None): 0}
    assert of_node == pytest.approx({key: count * 800 / 0.15 for key, count in packets.items()})
    assert tdma.capacity_bps(100, 64e3) == pytest.approx(11 * 800 / 0.15)
    assert tdma.capacity_bps(400, 64e3) == 0.0


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "duration_s: 0.05}",
            "duration_s: -1}",
            "slots.yaml:4: slots.0.duration_s: has to be greater than 0 [(]got -1[)]",
        ),
        (
            "bit_rate_bps: 128e3",
            "bit_rate_bps: fast",
            "slots.yaml:7: slots.3.bit_rate_bps: has to be a number [(]got 'fast'[)]",
        ),
        ("priority: 5", "prioity: 5", "slots.yaml:7: slots.3.prioity: unknown key; did you mean priority?"),
        ("nodes: g1, ", "", "slots.yaml:5: slots.1.nodes: is required, and missing"),
        ("nodes: g1", "nodes: []", "slots.yaml:5: slots.1.nodes: has to have at least 1 item, not 0"),
        ("channel: 2, ", "", "slots.yaml:6: slots.2: it runs at the time of slots.1: both are on channel 0"),
        (
            "listeners: g3",
            "listeners: 0",
            "slots.yaml:6: slots.2: it runs at the time of slots.1: 0 cannot be in both",
        ),
        (
            "guard_s: 0.002",
            "guard_s: 0.02",
            "slots.yaml:7: slots.3: a slot of 0.02 s with a guard of 0.02 s has no",
        ),
        (
            "round_s: 0.15",
            "round_s: 0.11",
            "slots.yaml:7: slots.3: from 0.1 s to 0.12 s is not within the round of 0.11",
        ),
        ("slots:", "slots: [", "slots.yaml:4: is not YAML"),
    ],
)
def test_a_mistake_names_file_line_key_and_value(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert SLOTS_TEXT.count(old) >= 1
    with pytest.raises(PresetError, match=rf"^{re.escape(str(tmp_path))}/{told}"):
        radio(tmp_path, SLOTS_TEXT.replace(old, new, 1))


def test_a_file_that_is_not_there_is_told_with_its_key(tmp_path: Path) -> None:
    with pytest.raises(PresetError, match=r"^medium\.schedule_file: cannot read .*none\.yaml: No such file"):
        radio(tmp_path, schedule_file="none.yaml")


@pytest.mark.parametrize("changes", [{"slots": ["0"]}, {"guard_s": 0.001}, {"channels": {"0": 1}}])
def test_what_slots_have_of_their_own_is_not_given_beside_them(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    [key] = changes
    with pytest.raises(PresetError, match=f"medium: {key}: the slots of a schedule have their own"):
        radio(tmp_path, **changes)
    with pytest.raises(PresetError, match="medium: has to have either slot_s or schedule"):
        radio(tmp_path, slot_s=0.1)


def test_a_slot_of_nobody_names_the_file(tmp_path: Path) -> None:
    config, nodes = radio(tmp_path), {"0": 0, "g1": 1, "g2": 2}
    surroundings = Surroundings.of(PlainWorld(range(3)), nodes, 1, config, -110.0)
    with pytest.raises(ValueError, match=r"/slots\.yaml: medium: node g3 is not there; there are 0, g1, g2"):
        config.medium.open(surroundings)


def test_a_schedule_is_built_once_and_its_cost_does_not_grow_with_the_square_of_its_slots(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """10,000 slots one after the other: none is compared with a slot that it does not meet."""
    compared = 0

    def clash(one: object, other: object) -> str:
        nonlocal compared
        compared += 1
        return ""

    monkeypatch.setattr(module, "_clash", clash)
    slots = [{"nodes": str(number % 50), "duration_s": 0.01} for number in range(10_000)]
    found = radio_from_mapping(
        {"preset": "telemetry-915", "medium": {"model": "tdma", "schedule": {"slots": slots}}}
    ).medium
    assert isinstance(found, TdmaMedium)
    assert found.schedule is not None
    assert found.schedule.by_id is found.schedule.by_id
    assert found.schedule.by_id.round_ns == 10_000 * 10 * MS
    assert compared == 0
