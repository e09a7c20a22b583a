"""`reset`, `step` and `close` of learning libraries: an episode is a flight in which a program outside decides.

python examples/learning/environment.py
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Client, Connection, Listener
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

from lostlink import RunResult, fly

HERE = Path(__file__).parent
UNKEPT = {"figure": False, "mcap.write": False, "mavlink.tlog": False}
"""What an episode need not write."""


class Environment:
    """Episodes of `steered.yaml`; the reward of a step are the packets heard and the metres gone.

    Left (`with`), it ends the episode: else the flight waits for a decision, and Python for the flight.

    Args:
        directory: where the runs go.
        changes: of the scenario, by dotted key.
    """

    def __init__(self, directory: str | Path, changes: dict[str, Any] | None = None) -> None:
        self._directory, self._changes = directory, UNKEPT | (changes or {})
        self._pool = ThreadPoolExecutor(1)
        self._flight: Future[RunResult] | None = None
        self._agent: Connection | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def reset(self, seed: int) -> dict[str, float]:
        """Begin an episode; gives what the agent sees when it has taken off.

        Raises:
            RuntimeError: the flight ended before that.
            ScenarioError, FleetError: it cannot begin.
        """
        self.close()
        with TemporaryDirectory() as folder:
            address = str(Path(folder) / "agent")
            with Listener(address) as listener:
                self._flight = self._pool.submit(self._fly, seed, address)
                self._agent = listener.accept()
        self._seen = self._next()
        if self._seen is None:
            result = self.close()
            raise RuntimeError(f"it was over before the first decision: {result.error or result.verdict}")
        return self._seen

    def step(self, north_mps: float) -> tuple[dict[str, float], float, bool]:
        """Have the agent fly on with this; gives what it sees after a period, the reward, and whether that was all.

        Raises:
            RuntimeError: the flight broke off.
        """
        before = self._seen
        with suppress(OSError):  # the flight may be over, whose end is then the answer
            self._agent.send(north_mps)
        after = self._next()
        if after is None:
            if error := self._flight.result().error:
                raise RuntimeError(error)
            return before, 0.0, True
        self._seen = after
        return after, after["heard"] + 0.1 * (after["north_m"] - before["north_m"]), False

    def close(self) -> RunResult | None:
        """End the episode, if there is one; gives its run."""
        if self._flight is None:
            return None
        flight, self._flight = self._flight, None
        if self._agent is None:  # it finds nobody to ask, which ends it
            return flight.result()
        with suppress(OSError):  # which is over
            self._agent.send(None)
        result = flight.result()
        self._agent.close()
        return result

    def _next(self) -> dict[str, float] | None:
        try:
            seen: dict[str, float] = self._agent.recv()
        except (EOFError, OSError):
            return None
        return seen

    def _fly(self, seed: int, address: str) -> RunResult:
        changes = self._changes | {"nodes.0.agent.options.address": address}
        try:
            return fly(
                HERE / "steered.yaml",
                seed=seed,
                changes=changes,
                first_slot="auto",
                directory=self._directory,
            )
        finally:
            with suppress(OSError):  # nobody waits any more for an agent that never asked
                Client(address).close()


def main() -> None:
    """Fly out as long as most packets of the ground station come, and back where they do not."""
    total, is_over = 0.0, False
    with Environment("runs") as environment:
        seen = environment.reset(seed=1)
        while not is_over:
            seen, reward, is_over = environment.step(8.0 if seen["heard"] >= 3 else -8.0)
            total += reward
        print(f"{total:.1f}", environment.close())


if __name__ == "__main__":
    main()
