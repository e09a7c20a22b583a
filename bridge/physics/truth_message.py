"""From the flight dynamics to messages: true states in the fleet's frame, and the clock."""

from __future__ import annotations

from bridge.bus import messages
from bridge.bus.messages import Header, Quaternion, Vector3
from bridge.scenario.resolve.ground_track import GroundPlaceAt
from fdm.clock.fleet_clock import ClockStatus
from fdm.model.geodesy import GeodeticPosition, ned_from_geodetic
from fdm.model.truth import TrueState

STANDARD_GRAVITY_MPS2 = 9.80665


def truth_message(truth: TrueState, origin: GeodeticPosition) -> messages.Truth:
    """A true state with its position from the fleet's origin, the frame that the radio computes in."""
    here = GeodeticPosition(truth.lat_deg, truth.lon_deg, truth.alt_amsl_m)
    w, x, y, z = truth.attitude_wxyz
    return messages.Truth(
        Header.at(truth.sim_time_ns, str(truth.ua_id)),
        truth.lon_deg,
        truth.lat_deg,
        truth.alt_amsl_m,
        Vector3(*ned_from_geodetic(origin, here)),
        Vector3(*truth.velocity_ned_mps),
        Quaternion(x, y, z, w),
        Vector3(*truth.body_rates_frd_radps),
        Vector3(*truth.specific_force_frd_mps2),
        truth.airspeed_mps,
        Vector3(*truth.wind_ned_mps),
    )


def ground_truth_message(node: str, place: GroundPlaceAt, sim_time_ns: int) -> messages.Truth:
    """The true state of a node on the ground: it is level, and feels its weight."""
    return messages.Truth(
        Header.at(sim_time_ns, node),
        place.position.lon_deg,
        place.position.lat_deg,
        place.position.alt_amsl_m,
        Vector3(*place.position_ned_m),
        Vector3(*place.velocity_ned_mps),
        specific_force_frd_mps2=Vector3(0.0, 0.0, -STANDARD_GRAVITY_MPS2),
    )


def clock_message(status: ClockStatus) -> messages.Clock:
    """A tick of the fleet clock."""
    return messages.Clock(
        Header.at(status.sim_time_ns, ""),
        status.speed,
        status.real_time_factor,
        status.paused,
        tuple(str(ua_id) for ua_id in status.stalled_ua),
        tuple(str(ua_id) for ua_id in status.ended_ua),
    )
