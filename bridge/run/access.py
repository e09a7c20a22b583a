"""How a program on this machine gets into a run: where its router is, and as whom to log in there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bridge.bus.identity.keyring import Credentials, Keyring
from bridge.bus.session import Session, SessionError, open_client
from bridge.run.directory import RunDirectory

RUNS = Path("runs")
"""Where runs are kept, unless somebody says otherwise."""


class NoAccess(SessionError):
    """There is no such run, or it is over, or it has no such identity."""


@dataclass(frozen=True, slots=True)
class Access:
    """What it takes to join a run.

    Attributes:
        run: its name, in all of its keys.
        endpoint: of its Zenoh router.
        credentials: as whom.
    """

    run: str
    endpoint: str
    credentials: Credentials

    def open(self) -> Session:
        """Join.

        Raises:
            SessionError: there is no router any more, or it does not let this user in.
        """
        return open_client(self.endpoint, self.credentials)


def endpoint_of(run: RunDirectory) -> str:
    """Where the Zenoh router of a run listens.

    Raises:
        NoAccess: it has none.
        OSError, ValueError: it is no run.
    """
    if not run.info.endpoint:
        raise NoAccess(
            f"the run {run.path} has no Zenoh beside it: fly it with --zenoh (zenoh: true in its scenario)"
        )
    return run.info.endpoint


def access_of(run: str | Path, identity: str) -> Access:
    """As ``identity`` into a run that goes on.

    Args:
        run: its directory, or its name if that is in `runs/`.
        identity: such as ``node-1``, ``operator`` or ``observer``.

    Raises:
        NoAccess: the text says why.
    """
    directory = directory_of(run)
    try:
        info = directory.info
    except (OSError, ValueError) as error:
        raise NoAccess(f"{directory.path} is no run: {error}") from error
    if not directory.is_live:
        raise NoAccess(f"the run {directory.path} is over")
    endpoint_of(directory)
    keyring = Keyring(Path(info.secrets))
    try:
        names = [known.name for known in keyring.identities]
        if identity in names:
            return Access(info.run, info.endpoint, keyring.credentials(identity))
    except FileNotFoundError:
        raise NoAccess(f"the run {directory.path} is over") from None
    except PermissionError:
        raise NoAccess(f"the run {directory.path} is another user's, who has its passwords") from None
    except (OSError, ValueError) as error:
        raise NoAccess(str(error)) from error
    known = ", ".join(names)
    raise NoAccess(f"{directory.path}: nobody is called {identity!r} there; known: {known}")


def place_of(run: str | Path) -> Path | None:
    """A directory, or that of the name in `runs/`; None if there is neither."""
    return next((path for path in (Path(run), RUNS / run) if path.is_dir()), None)


def directory_of(run: str | Path) -> RunDirectory:
    """The directory of a run, or of one in `runs/`.

    Raises:
        NoAccess: there is no such run.
    """
    place = place_of(run)
    if place is None:
        raise NoAccess(f"there is no run {run}, nor {RUNS / run}")
    return RunDirectory(place)
