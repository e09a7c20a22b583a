"""Where every emitter was: tracks of stations that exchange no packets, by name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel.checks import ChannelInputError, FloatArray
from channel.medium.stations.tracks import Snapshot, Tracks, truth_rows


class EmitterTracks:
    """The recent places of a fixed set of emitters, in the frame common to all.

    Args:
        names: of the emitters.
        max_age_ns, ahead_ns: as of the tracks of nodes.

    Attributes:
        names: in their order.

    Raises:
        ChannelInputError: names that are not distinct.
    """

    def __init__(self, names: Iterable[str], max_age_ns: int, ahead_ns: int = 0) -> None:
        self.names = tuple(names)
        self._index = {name: i for i, name in enumerate(self.names)}
        if len(self._index) != len(self.names):
            raise ChannelInputError("emitters", self.names, "names that differ")
        self._tracks = Tracks(len(self.names), max_age_ns, ahead_ns)

    def observe(self, names: Sequence[str], sim_time_ns: int, position_ned_m: ArrayLike) -> None:
        """Take in where emitters were.

        Args:
            names: which, each once.
            sim_time_ns: when.
            position_ned_m: shape (emitters, 3).

        Raises:
            ChannelInputError: an emitter that is not there, another shape, or a number that is not finite.
        """
        unknown = [name for name in names if name not in self._index]
        if unknown:
            raise ChannelInputError("emitter", unknown[0], f"one of {', '.join(self.names)}")
        rows = np.atleast_2d(truth_rows(position_ned_m, None))
        if len(rows) != len(names):
            raise ChannelInputError("position_ned_m", f"{len(rows)} rows", f"{len(names)}, one for each")
        self._tracks.observe(np.array([self._index[name] for name in names]), sim_time_ns, rows)

    @property
    def are_known(self) -> bool:
        """Whether all of them were ever seen."""
        return self._tracks.all_known or not self.names

    def snapshot(self, instants_ns: NDArray[np.int64]) -> Snapshot:
        """Return where all of them were at some instants, with their velocities; see `Tracks.at`.

        Raises:
            ChannelInputError: one of them was never seen.
        """
        if not self._tracks.all_known:
            missing = [name for name, known in zip(self.names, self._tracks.known, strict=True) if not known]
            raise ChannelInputError("emitters", missing[0], "emitters whose places were observed")
        return self._tracks.at(instants_ns, velocity=True)

    def at(self, instants_ns: NDArray[np.int64], instant: NDArray[np.intp] | None) -> dict[str, FloatArray]:
        """Return places by name: shape (3,) at the only instant, or (L, 3) where each link has its own among several.

        Args:
            instants_ns: rising.
            instant: of each link, shape (L,); None: there is one for all.
        """
        places = self.snapshot(instants_ns).position_ned_m.T
        if instant is None:
            return {name: places[i] for name, i in self._index.items()}
        count = len(self.names)
        return {name: places[instant * count + i] for name, i in self._index.items()}
