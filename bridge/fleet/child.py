"""Child processes of the supervisor: started apart from the terminal, and ended for sure."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

LEASH = Path(__file__).with_name("leash.py")


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """What to start.

    Attributes:
        name: for messages, the log's name and the liveliness token.
        command: program and arguments.
        log_path: where its output goes.
        cwd: its working directory; None for ours.
        environment: all of its environment variables; None for ours.
        stop_signal: how it is asked to end.
        pass_fds: file descriptors that it inherits.
    """

    name: str
    command: Sequence[str]
    log_path: Path
    cwd: Path | None = None
    environment: Mapping[str, str] | None = field(default=None, hash=False)
    stop_signal: signal.Signals = signal.SIGTERM
    pass_fds: tuple[int, ...] = ()


class Child:
    """A running child process."""

    def __init__(self, spec: ProcessSpec, process: asyncio.subprocess.Process) -> None:
        self.spec = spec
        self._process = process
        self.ended = asyncio.create_task(process.wait(), name=f"wait for {spec.name}")

    @classmethod
    async def start(cls, spec: ProcessSpec) -> Child:
        """Start the process; its output goes to its log.

        Raises:
            OSError: if the program or its working directory is not there.
        """
        with spec.log_path.open("wb") as log:
            process = await asyncio.create_subprocess_exec(
                *on_a_leash(spec.command),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=log,
                stderr=asyncio.subprocess.STDOUT,
                cwd=spec.cwd,
                env=spec.environment,
                pass_fds=spec.pass_fds,
                start_new_session=True,  # Ctrl-C reaches the supervisor only, which ends the others in order
            )
        return cls(spec, process)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def how_it_ended(self) -> str:
        """Exit status or signal, in words."""
        status = self._process.returncode
        if status is None:
            return "still runs"
        return f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"

    def ask_to_end(self) -> None:
        """Send its stop signal."""
        self._signal(self.spec.stop_signal)

    def kill(self) -> None:
        """End it at once."""
        self._signal(signal.SIGKILL)

    def _signal(self, number: signal.Signals) -> None:
        """Not by asyncio's ``send_signal``, which may take the exit status that its own watcher waits for (3.11).

        That watcher takes it in a thread, just before ``returncode`` tells: a signal in between goes to a pid that is
        free, which a kernel gives out again only after tens of thousands of others.
        """
        if self._process.returncode is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def log_tail(self, lines: int = 5) -> str:
        """The last lines of its log."""
        text = self.spec.log_path.read_text(encoding="utf-8", errors="replace")
        return "\n".join(text.rstrip().splitlines()[-lines:])


def on_a_leash(command: Sequence[str]) -> list[str]:
    """The command such that the kernel ends it with us, where the kernel can (see leash.py)."""
    if sys.platform != "linux":
        return list(command)
    # -I -S: a bare interpreter, gone within 20 ms, that looks at neither environment nor site packages.
    return [sys.executable, "-I", "-S", str(LEASH), str(os.getpid()), *command]


async def end_all(children: Sequence[Child], grace_s: float) -> list[str]:
    """Ask all to end, wait ``grace_s`` (wall time), kill those that are left. Returns the names of the killed."""
    for child in children:
        child.ask_to_end()
    waiting = [child.ended for child in children]
    if waiting:
        await asyncio.wait(waiting, timeout=grace_s)
    late = [child for child in children if not child.ended.done()]
    for child in late:
        child.kill()
    await asyncio.gather(*waiting)
    return [child.spec.name for child in late]


async def end_with_news(child: Child, news: asyncio.Event, patience_s: float) -> list[str]:
    """Ask a process to end that has much to do first: it has time as long as ``news`` comes within ``patience_s``.

    Returns:
        Its name if it had to be killed.
    """
    child.ask_to_end()
    while not child.ended.done():
        news.clear()
        waiting = asyncio.create_task(news.wait())
        await asyncio.wait({child.ended, waiting}, timeout=patience_s, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if not child.ended.done() and not news.is_set():
            return await end_all([child], 0.0)
    return []
