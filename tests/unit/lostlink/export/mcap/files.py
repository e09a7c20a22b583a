"""Reads MCAP files with nothing of ours: the reader of the format, and decoders made from the schemas in the file."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


@dataclass
class Read:
    """What is in a file."""

    messages: dict[str, list[Any]] = field(default_factory=dict)
    """By topic, decoded."""
    times_ns: dict[str, list[int]] = field(default_factory=dict)
    schemas: dict[str, str] = field(default_factory=dict)
    """Type by topic."""
    metadata: dict[str, str] = field(default_factory=dict)
    statistics: Counter[str] = field(default_factory=Counter)
    """Messages by topic, as the file's summary has it."""

    @property
    def counts(self) -> dict[str, int]:
        return {topic: len(messages) for topic, messages in self.messages.items()}


def read_mcap(path: Path) -> Read:
    """Every message, decoded by the schema that the file has for its topic; in the order of the file."""
    read = Read()
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        for number, count in summary.statistics.channel_message_counts.items():
            read.statistics[summary.channels[number].topic] = count
        before_ns = 0
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            assert schema is not None
            assert message.log_time >= before_ns, "messages are in the order of sim time"
            before_ns = message.log_time
            read.messages.setdefault(channel.topic, []).append(decoded)
            read.times_ns.setdefault(channel.topic, []).append(message.log_time)
            read.schemas[channel.topic] = schema.name
        for metadata in reader.iter_metadata():
            read.metadata |= metadata.metadata
    return read
