"""All time-outs of aps in one place, and how they fit each other.

They run on three clocks. The daemon's clock is monotonic wall time, or sim time in held mode; the
autopilot's own is ``time_boot_ms``, sim time since its boot; wall time is what a host waits.

A request is repeated (ACK_TIMEOUTS_S: 16 s in all) for less long than a lost link is forgiven
(LINK_LOSS_TIMEOUT_S), so a link that comes back after a few seconds finds its transfer still being asked for,
and its flight still followed. A command that has not been accepted ends with the link. Both times are shorter
than a route lives (ROUTE_EXPIRY_S), so the answer finds its way back. After acceptance a command may take as
long as its flight is long, in the autopilot's time; since that time stands still when the autopilot is silent
or its simulation paused, SILENCE_TIMEOUT_S bounds the standstill by the daemon's clock. It exceeds all the
others: a command ends for the most specific reason.
"""

from __future__ import annotations

from typing import Final

# Wall time: the sockets.

CONNECT_TIMEOUT_S: Final = 5.0
"""For one attempt to connect to the autopilot."""
FIRST_RETRY_S: Final = 0.1
LONGEST_RETRY_S: Final = 2.0
"""Between attempts, doubling: short, since a simulated autopilot is there within a second or two."""

UDP_RETRY_S: Final = 1.0
"""Between attempts to open a UDP socket whose peer's name cannot be looked up yet."""
PEER_SILENCE_S: Final = 20.0
"""For a UDP peer that says nothing, until it counts as gone: twenty missing heartbeats."""

# The daemon's clock: messages and their answers.

HEARTBEAT_PERIOD_S: Final = 1.0
"""Between our heartbeats, as MAVLink asks."""
CONNECTED_S: Final = 5.0
"""Since the autopilot's last heartbeat, until it no longer counts as connected: five are missing."""
ACK_TIMEOUTS_S: Final = (1.0, 1.0, 2.0, 4.0, 8.0)
"""For an acknowledgement, per try; after the last the command has timed out."""
IN_PROGRESS_TIMEOUT_S: Final = 60.0
"""After the autopilot has said that a command is in progress, until it says so again or is done."""
REASON_GRACE_S: Final = 0.3
"""After a refusal without a STATUSTEXT: for one to come (ArduPilot queues them apart)."""
SHOWN_LAG_S: Final = 0.2
"""From an acknowledgement until a heartbeat shows what was done: one that comes earlier may be older ..."""
SHOWN_TIMEOUT_S: Final = 2.0
"""... and if none comes for so long, the acknowledgement counts."""
STREAM_ACK_TIMEOUT_S: Final = 1.0
"""For the answer to a stream request, times the number of the try: 1, 2, 3, 4, 5 s."""
STREAM_TRIES: Final = 5
"""Then the next stream is asked for, and this one again later."""
TRANSFER_TIMEOUTS_S: Final = (1.0, 1.0, 1.5, 2.0, 2.0, 3.0, 3.0, 4.0)
"""For the next message of a mission, parameter or file transfer, per try; counted anew with each that comes."""
PARAMETER_GAP_S: Final = 1.0
"""Since the last parameter of a list, until those that are missing are asked for."""
CHUNK_TIMEOUT_S: Final = 1.0
"""For the next chunk of a long STATUSTEXT; then what has come is told."""
LINK_LOSS_TIMEOUT_S: Final = 30.0
"""For an accepted command, or a transfer, whose link is down."""
ROUTE_EXPIRY_S: Final = 60.0
"""Since the last frame of a sender, until its route is forgotten: 60 missing heartbeats."""
SILENCE_TIMEOUT_S: Final = 600.0
"""For an accepted command whose autopilot's clock stands still, by wall time. A paused simulation looks like an
autopilot that hangs, so this is long: a pause of up to ten minutes does not end a command."""
HELD_SILENCE_TIMEOUT_S: Final = 30.0
"""The same in held mode: sim time stands still in a pause, too, so this can be as short as that of a lost link."""

# The autopilot's own time: what happens in flight.

OWED_HEARTBEATS: Final = 3
"""Heartbeats of the autopilot (1 Hz of its time) after which an acknowledgement that has not come will not come: it
answers within one of its loops, and the heartbeats of a paused simulation wait as well."""
SILENT_HEARTBEATS: Final = 4
"""Heartbeats in a row without any message that carries its clock: its streams are gone."""
FEEDBACK_PERIOD_MS: Final = 500
"""Between two pieces of feedback of a command."""
ARMED_GRACE_MS: Final = 3000
"""For a heartbeat to show that the UA is armed."""
ONWARD_GRACE_MS: Final = 1000
"""From the heartbeat with a mode that the autopilot goes on in by itself to the text that says so."""
REBOOT_STEP_MS: Final = 2000
"""The autopilot's clock going back by more than this is a reboot (less is reordering between streams)."""
MODE_TIMEOUT_S: Final = 10.0
"""From acceptance until the heartbeat shows the mode, or that the UA is armed or disarmed."""
REBOOT_TIMEOUT_S: Final = 60.0
"""From acceptance until the autopilot's clock begins anew."""
LANDING_TIMEOUT_S: Final = 900.0
"""From acceptance until it is down, and for a leg of unknown length."""
