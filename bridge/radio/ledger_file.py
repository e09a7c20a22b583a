"""The counters of the radio, in `ledger.json`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeVar

from bridge.bus.keys import MAIN
from bridge.run.json_object import read_object, write_object
from channel.medium.judge.check import Verdict
from channel.medium.ledger import Ledger
from channel.routing.routed import RoutingCounts

if TYPE_CHECKING:
    from bridge.scenario.resolve.channel import RadioChannel

LEDGER = "ledger.json"
BINS_OF_PACKETS = "packets"
BINS_OF_TRANSMISSIONS = "transmissions"
"""Distance bins count the first transmission of each packet at all nodes that it meets, as if alone on the air."""
NOTHING_JUDGED = Verdict(())
Refusal = TypeVar("Refusal", bound=StrEnum)
OnProgress = Callable[[float], object]


class Books(NamedTuple):
    """The books of one radio network.

    Attributes:
        ledger: what was sent and what became of it.
        verdict: of the channel's judge.
        shares_draws: whether packets share what is drawn: then their ratio has no binomial interval.
        radio: name of the network.
        routing: what that cost; None: nodes do not hand packets on.
        takes_time: whether packets take time on the air: then the distance bins are of transmissions.
    """

    ledger: Ledger
    verdict: Verdict = NOTHING_JUDGED
    shares_draws: bool = False
    radio: str = MAIN
    routing: RoutingCounts | None = None
    takes_time: bool = False

    @classmethod
    def of(cls, channel: RadioChannel, ledger: Ledger) -> Self:
        """Those of a channel at the end of its run."""
        return cls(
            ledger,
            channel.judge.verdict(),
            channel.shares_draws,
            channel.name,
            channel.routing,
            channel.network is not None,
        )


def write_ledger(
    path: Path,
    books: Sequence[Books],
    refused: Mapping[Refusal, int],
    progress: OnProgress = lambda _: None,
) -> None:
    """Write the counters: per directed link, what was measured and predicted per bin, what was not taken; the verdict.

    ``progress`` is called now and then with the share of the bins that is done.
    """
    content = {
        "links": [link for each in books for link in _links(each)],
        "bins": [
            row
            for number, each in enumerate(books)
            for row in _bins(each, partial(_share, progress, number, len(books)))
        ],
        "refused": {r.value: n for r, n in sorted(refused.items())},
        **judged_in(books),
    }
    routing = [{"radio": each.radio, **asdict(each.routing)} for each in books if each.routing is not None]
    if routing:
        content["routing"] = routing
    write_object(path, content)


def read_ledger(path: Path) -> dict[str, Any]:
    """What `write_ledger` wrote; nothing if there is no file.

    Raises:
        OSError: it cannot be read.
        ValueError: it is damaged.
    """
    return read_object(path, "damaged") if path.exists() else {}


def judged_in(books: Sequence[Books]) -> dict[str, list[dict[str, Any]]]:
    """The checks of all networks, and what could not be judged; of several each with its network's name."""
    checks, unjudged = [], []
    for each in books:
        prefix = f"{each.radio}: " if len(books) > 1 else ""
        checks += [check._replace(name=prefix + check.name).plain for check in each.verdict.checks]
        unjudged += [item._replace(name=prefix + item.name)._asdict() for item in each.verdict.unjudged]
    return {"checks": checks, "unjudged": unjudged}


def _share(progress: OnProgress, number: int, of: int, done: float) -> None:
    progress((number + done) / of)


def _links(books: Books) -> Iterator[dict[str, Any]]:
    for (tx, rx), a in sorted(books.ledger.links.items()):
        lost = dict(sorted(a.lost.items()))
        ends = {"radio": books.radio, "tx": tx, "rx": rx}
        yield ends | {"sent": a.sent, "delivered": a.delivered, "lost": lost}


def _bins(books: Books, progress: OnProgress) -> Iterator[dict[str, Any]]:
    for b in books.ledger.bins(progress):
        yield {
            "radio": books.radio,
            "tx": b.tx,
            "rx": b.rx,
            "distance_min_m": b.distance_min_m,
            "distance_max_m": b.distance_max_m,
            "of": BINS_OF_TRANSMISSIONS if books.takes_time else BINS_OF_PACKETS,
            "sent": b.sent,
            "delivered": b.delivered,
            "measured": b.measured,
            "predicted": b.predicted,
            "ci99": None if books.shares_draws else [b.ci99_low, b.ci99_high],
        }
