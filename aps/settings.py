"""What the command line and a YAML file say, as the settings of daemons."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, Field

from aps.config import DaemonConfig
from aps.links.address import parse_address, parse_autopilot, parse_host_port
from sitl_configs.config_file import read_model

AUTOPILOT_PORT: Final = 5760
LISTEN_PORT: Final = 6760
PORT_STRIDE: Final = 10
LINK_KINDS: Final = ("tcp_server", "tcp", "udp_out", "udp_in", "serial")
"""Keys, and with dashes options, that open links for clients."""


class SettingsError(ValueError):
    """The settings cannot be used; the text has one line per mistake."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class DaemonSettings(_Part):
    """One daemon, as in a file or on the command line; what is left out follows from ``index``."""

    index: int = Field(0, ge=0, le=254)
    autopilot: tuple[str, ...] = ()
    """Ways to the autopilot, the preferred one first (tcp:127.0.0.1:5760 + 10 I)."""
    sysid: int | None = Field(None, ge=1, le=255)
    tcp_server: tuple[str, ...] = ()
    """HOST:PORT or :PORT to serve clients on (127.0.0.1:6760 + 10 I)."""
    tcp: tuple[str, ...] = ()
    """HOST:PORT of servers to connect to."""
    udp_out: tuple[str, ...] = ()
    udp_in: tuple[str, ...] = ()
    serial: tuple[str, ...] = ()
    """DEVICE:BAUD of lines to clients."""
    tlog: Path | None = None
    """Directory for .tlog files."""

    def config(self) -> DaemonConfig:
        """The daemon's settings.

        Raises:
            ValueError: an address cannot be read.
        """
        autopilots = self.autopilot or (f"tcp:127.0.0.1:{AUTOPILOT_PORT + PORT_STRIDE * self.index}",)
        servers = self.tcp_server or (f"127.0.0.1:{LISTEN_PORT + PORT_STRIDE * self.index}",)
        for text in autopilots:
            parse_autopilot(text)
        links = [f"tcp-server:{text}" for text in servers[1:]]
        links += [
            f"{kind.replace('_', '-')}:{text}" for kind in LINK_KINDS[1:] for text in getattr(self, kind)
        ]
        for text in links:
            parse_address(text)
        host, port = parse_host_port(_with_host(servers[0]), lowest_port=0)
        return DaemonConfig(
            autopilot=autopilots[0],
            more_autopilots=autopilots[1:],
            sysid=self.index + 1 if self.sysid is None else self.sysid,
            listen_host=host,
            listen_port=port,
            links=tuple(links),
            tlog_directory=self.tlog,
        )


def _with_host(text: str) -> str:
    return f"127.0.0.1{text}" if text.startswith(":") else text


class FileSettings(_Part):
    """A file: one or several daemons, all in one process."""

    daemons: tuple[DaemonSettings, ...] = Field(min_length=1)


def read_settings(path: Path) -> FileSettings:
    """Read a YAML file.

    Raises:
        SettingsError: it cannot be read, is no YAML, or has wrong keys or values.
    """
    return read_model(path, FileSettings, SettingsError)
