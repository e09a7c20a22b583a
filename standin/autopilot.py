"""The whole autopilot without I/O and without a clock: bytes in, bytes out.

One turn: ``take_frame`` a datagram of the physics, ``mavlink.receive`` what the client sent until then,
``step``, send ``mavlink.data_to_send()``, send the packet. What it sends depends on those bytes alone.
"""

from __future__ import annotations

from standin.protocols.endpoint import MavlinkEndpoint
from standin.vehicle.location import Location
from standin.vehicle.parameters import StandinParameters
from standin.vehicle.vehicle import StandinVehicle
from standin.wire.fdm_link import FdmLink


class Autopilot:
    """Joins the physics link, the vehicle and the MAVLink endpoint."""

    def __init__(
        self, home: Location, parameters: StandinParameters, *, frame_rate_hz: int, boot_unix_us: int
    ) -> None:
        self.vehicle = StandinVehicle(home, parameters)
        self.fdm = FdmLink(frame_rate_hz)
        self.mavlink = MavlinkEndpoint(self.vehicle, boot_unix_us)

    def take_frame(self, datagram: bytes) -> bool:
        """Take a datagram of the physics; return whether it is a new frame, on which to ``step``."""
        frame = self.fdm.receive(datagram)
        if frame is None:
            return False
        self.vehicle.sense(frame, self.fdm.sim_time_ns, self.fdm.step_s)
        return True

    def step(self) -> bytes:
        """Obey the client, control the vehicle, report; return the servo packet that answers the frame."""
        self.mavlink.obey()
        outputs = self.vehicle.step()
        self.mavlink.report()
        return self.fdm.answer(outputs)
