"""The whole autopilot without I/O and without a clock: bytes in, bytes out.

One turn: ``take_frame`` a frame of the physics, ``mavlink.receive`` what the client sent until then,
``step``, send ``mavlink.data_to_send()``, send ``fdm.packet``; likewise with each of the ``serials``. What it sends
depends on those frames and bytes alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from standin.protocols.endpoint import MavlinkEndpoint
from standin.vehicle.auto import Auto
from standin.vehicle.location import Location
from standin.vehicle.modes import Brake, Guided, Land, Loiter, ReturnToLaunch, Stabilize
from standin.vehicle.parameters import StandinParameters
from standin.vehicle.vehicle import Modes, StandinVehicle
from standin.wire.fdm_link import FdmLink
from standin.wire.sensors import SensedFrame

MODES: Final[Modes] = {
    int(mode.number): mode for mode in (Stabilize, Auto, Guided, Loiter, ReturnToLaunch, Land, Brake)
}
NO_SERIALS: Final[Mapping[int, int]] = MappingProxyType({})


class Autopilot:
    """Joins the physics link, the vehicle and its MAVLink ports.

    Args:
        home: where it stands.
        parameters: their values.
        frame_rate_hz: asked of the physics.
        boot_unix_us: GPS time at boot.
        serials: of further ports the number and the baud rate (0: no limit).

    Attributes:
        mavlink: the first port.
        serials: the further ones, by number.
    """

    def __init__(
        self,
        home: Location,
        parameters: StandinParameters,
        *,
        frame_rate_hz: int,
        boot_unix_us: int,
        serials: Mapping[int, int] = NO_SERIALS,
    ) -> None:
        self.vehicle = StandinVehicle(home, parameters, MODES)
        self.fdm = FdmLink(frame_rate_hz)
        self.mavlink = MavlinkEndpoint(self.vehicle, boot_unix_us)
        self.serials = {
            number: MavlinkEndpoint(self.vehicle, boot_unix_us, baud) for number, baud in serials.items()
        }
        self._ports = (self.mavlink, *self.serials.values())
        for port in self._ports:
            port.told_together = self._ports

    def take_frame(self, frame: SensedFrame | None) -> bool:
        """Take what the physics sent, None if it was no frame; return whether it is a new one, on which to ``step``."""
        if not self.fdm.receive(frame) or frame is None:
            return False
        self.vehicle.sense(frame, self.fdm.sim_time_ns, self.fdm.step_s)
        return True

    def step(self) -> None:
        """Obey the clients, control the vehicle, report, answer the frame."""
        for port in self._ports:
            port.obey()
        outputs = self.vehicle.step()
        for port in self._ports:
            port.report()
        self.fdm.answer(outputs)
