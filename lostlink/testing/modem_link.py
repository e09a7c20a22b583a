"""A lossy radio link for a test: exchanges in a time of its own that always lose the same, or real sockets."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from bridge.endpoints.address import endpoint_of
from bridge.modem.pair import AIR, GROUND
from bridge.modem.radio_link import RadioLink
from lostlink.modem.live import NS_PER_S, LiveLink
from lostlink.modem.plan import DEFAULT_DISTANCE_M, DEFAULT_RADIO, Asked, plan_of
from lostlink.modem.report import summary


class Came(NamedTuple):
    """Bytes that came out at an end.

    Attributes:
        at_s: when, in the link's own time.
        data: one MAVLink frame, or bytes that are none.
    """

    at_s: float
    data: bytes


@dataclass(slots=True, repr=False)
class End:
    """One end of a scripted link.

    Attributes:
        came: all that came out here so far, in order; with the RADIO_STATUS of this end's own modem.
    """

    came: list[Came] = field(default_factory=list)
    _said: list[tuple[int, bytes]] = field(default_factory=list)

    def __repr__(self) -> str:
        """Short enough for what an assertion shows of it."""
        return f"<End: {len(self.came)} frames came, {len(self.data)} bytes>"

    def send(self, data: bytes, at_s: float) -> None:
        """Have this end's host send bytes at an instant of the link's time, in s."""
        self._said.append((round(at_s * NS_PER_S), data))

    def take(self, until_ns: int) -> list[tuple[int, bytes]]:
        """What was said for instants up to one, as (instant ns, bytes); it is said once."""
        taken = [each for each in self._said if each[0] <= until_ns]
        self._said = [each for each in self._said if each[0] > until_ns]
        return taken

    @property
    def data(self) -> bytes:
        """All that came out, as one stream."""
        return b"".join(each.data for each in self.came)


class ScriptedLink:
    """A pair of modems whose time goes on when the test says so: no clock, no socket, the same at each run.

    Attributes:
        gcs: the ground station's end.
        autopilot: the autopilot's.
    """

    def __init__(self, link: RadioLink) -> None:
        self._link = link
        self.gcs, self.autopilot = End(), End()

    def __repr__(self) -> str:
        return f"<ScriptedLink: gcs {self.gcs}, autopilot {self.autopilot}>"

    def run(self, until_s: float) -> None:
        """Let the link live up to an instant, with all that was said for it.

        Raises:
            ValueError: something was said for an instant that had passed.
        """
        until_ns = round(until_s * NS_PER_S)
        said = [(at_ns, GROUND, data) for at_ns, data in self.gcs.take(until_ns)]
        said += [(at_ns, AIR, data) for at_ns, data in self.autopilot.take(until_ns)]
        for at_ns, end, data in sorted(said, key=lambda each: each[0]):
            self._advance(at_ns)
            self._link.receive(end, data, at_ns)
        self._advance(until_ns)

    def _advance(self, until_ns: int) -> None:
        for end, (at_ns, data) in self._link.advance(until_ns):
            came = (self.gcs, self.autopilot)[end].came
            came.append(Came(at_ns / NS_PER_S, data))


@dataclass(frozen=True, slots=True)
class OpenLink:
    """A link in wall time.

    Attributes:
        gcs: where the ground station is to go: an endpoint's name, as ``tcpin:127.0.0.1:40123`` or ``/dev/pts/3``.
        autopilot: where the autopilot is.
        live: the link itself.
    """

    gcs: str
    autopilot: str
    live: LiveLink = field(repr=False)

    def summary(self) -> dict[str, Any]:
        """What was counted, as ``lostlink modem --json`` has it."""
        return summary(self.live, {})


class ModemLinks:
    """What the fixture `modem_link` is: makes links."""

    def __call__(
        self,
        radio: str = DEFAULT_RADIO,
        *,
        distance_m: float = DEFAULT_DISTANCE_M,
        distances: Path | Sequence[tuple[float, float]] | None = None,
        seed: int = 1,
        settings: Sequence[str] = (),
        heights_m: tuple[float, float] | None = None,
        baud: int | None = None,
    ) -> ScriptedLink:
        """A link in a time of its own, at its instant 0.

        Args:
            radio: a preset's name, or a file.
            distance_m: over the ground.
            distances: in its place (time s, distance m), or a CSV file with such columns.
            seed: of all that is drawn: the same exchange with the same seed loses the same.
            settings: as of ``--set``: ``radio.base_loss=0.1``.
            heights_m: of ground station and UA.
            baud: of both serial lines.

        Raises:
            ValueError, OSError: no such link can be; the text says why.
        """
        asked = Asked(radio, tuple(settings), distance_m, distances, heights_m, seed, baud)
        return ScriptedLink(RadioLink(plan_of(asked)))

    @asynccontextmanager
    async def open(
        self, gcs: str = "tcpin::0", autopilot: str = "tcpin::0", *, radio: str = DEFAULT_RADIO, **asked: Any
    ) -> AsyncIterator[OpenLink]:
        """A link in wall time between two endpoints of ``lostlink modem``; other arguments as of a call.

        What is lost then depends on the instants at which the programs send.

        Raises:
            ValueError, OSError: no such link can be, or an endpoint cannot be opened.
        """
        asked["settings"] = tuple(asked.get("settings", ()))
        endpoints = {GROUND: endpoint_of(gcs), AIR: endpoint_of(autopilot)}
        live = LiveLink(RadioLink(plan_of(Asked(radio, **asked))), endpoints)
        try:
            await live.open()
            yield OpenLink(endpoints[GROUND].name, endpoints[AIR].name, live)
        finally:
            await live.close()
