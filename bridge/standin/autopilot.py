"""The whole autopilot without I/O: datagrams and a client's bytes in, packets and bytes out."""

from __future__ import annotations

from bridge.standin.protocols.endpoint import MavlinkEndpoint
from bridge.standin.vehicle.location import Location
from bridge.standin.vehicle.parameters import Parameters
from bridge.standin.vehicle.vehicle import Vehicle
from bridge.standin.wire.fdm_link import FdmLink


class Autopilot:
    """Joins the physics link, the vehicle and the MAVLink endpoint."""

    def __init__(
        self, home: Location, parameters: Parameters, *, frame_rate_hz: int, boot_unix_us: int
    ) -> None:
        self.vehicle = Vehicle(home, parameters)
        self.fdm = FdmLink(frame_rate_hz)
        self.mavlink = MavlinkEndpoint(self.vehicle, boot_unix_us)

    def receive_sensors(self, datagram: bytes, now_s: float) -> bytes | None:
        """Take a datagram of the physics; return the servo packet that answers it, None if it needs none.

        What there is to say to the client at this instant waits in ``mavlink.data_to_send()``: send it
        first, so that who sees the servo packet's consequences has seen the telemetry before.

        Args:
            datagram: the bytes received.
            now_s: wall time (monotonic).
        """
        frame = self.fdm.receive(datagram)
        if frame is None:
            return None
        outputs = self.vehicle.step(frame, self.fdm.sim_time_ns, self.fdm.step_s)
        self.mavlink.step()
        return self.fdm.answer(outputs, now_s)
