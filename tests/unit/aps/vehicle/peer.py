"""A scripted autopilot that keeps missions, parameters and one file, behind a link that loses and corrupts frames.

It is written with pymavlink from the protocols' descriptions, and knows nothing of the daemon's own machines. Time is
counted in steps: nothing here waits.
"""

from __future__ import annotations

import struct
from collections import Counter

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.vehicle import Vehicle
from aps.wire.framer import Framer

SYSID, OURS = 7, 191
STEP_NS = 10_000_000
RETRY_STEPS = 100
"""Steps without an answer after which the autopilot asks again for an item: 1 s."""
PIECE_BYTES = 80
"""Of a file, in each of the messages of a burst."""
IDLE_STEPS = 300
"""Steps after which a file that nobody reads may be closed for another one: 3 s."""


class LossyLink:
    """Drops and corrupts frames, always the same ones."""

    def __init__(self, seed, drop, corrupt):
        self._random, self._drop, self._corrupt = np.random.default_rng(seed), drop, corrupt
        self.dropped = self.corrupted = 0

    def carry(self, frame):
        """The frame as it arrives; empty if it does not."""
        draw = self._random.random()
        if draw < self._drop:
            self.dropped += 1
            return b""
        if draw < self._drop + self._corrupt:
            self.corrupted += 1
            at = int(self._random.integers(len(frame)))
            return frame[:at] + bytes([frame[at] ^ (1 << int(self._random.integers(8)))]) + frame[at + 1 :]
        return frame


class KeepingAutopilot:
    """Missions of three kinds, parameters, and @PARAM/param.pck and further files if it knows FTP."""

    def __init__(self, parameters=(), ftp=True):
        self.mav = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.out = []
        self.heard = []
        self.items = {0: [], 1: [], 2: []}
        self.parameters = dict(parameters)
        self.ftp = ftp
        self.file = packed(self.parameters)
        self.files = {}
        """Further files: path -> content."""
        self.sizes = {}
        """What OPEN tells in place of a file's size, by path."""
        self._open = b""
        self._file_used = None
        """Step at which the file that is open was last used, or ``None``."""
        self._answer = None
        """The last answer about a file: it comes again if its request does."""
        self.mute = set()
        """Message types that are ignored."""
        self.lost = Counter()
        """Of message types, how many of the next that are said do not arrive."""
        self.acknowledges_again = False
        """Whether the last item of an upload that is over is acknowledged again (PX4), or is an error (ArduPilot)."""
        self.skip_from_list = set()
        """Indices of parameters that the list leaves out."""
        self.read_only = set()
        self.busy_with = None
        """(system, component) of another uploader."""
        self._upload = None
        self._steps = self._time = 0

    def say(self, message):
        if self.lost[message.get_type()]:
            self.lost[message.get_type()] -= 1
            return
        self.out.append(bytes(message.pack(self.mav)))

    def hear(self, data):
        for message in self.parser.parse_buffer(data) or []:
            if message.get_type() in ("BAD_DATA", *self.mute):
                continue
            self.heard.append(message)
            handler = getattr(self, "_" + message.get_type().lower(), None)
            if handler is not None:
                handler(message)

    def step(self):
        self._steps += 1
        self._time += 1
        if self._upload is not None and self._steps % RETRY_STEPS == 0:
            self._ask()

    # Missions.

    def _mission_count(self, message):
        if self.busy_with is not None:
            self._mission_ack_out(mavlink.MAV_MISSION_DENIED, message.mission_type)
            return
        self._upload = (message.mission_type, message.count, [])
        if message.count == 0:
            self._close()
        else:
            self._ask()

    def _ask(self):
        kind, _, items = self._upload
        self._steps = 0
        self.say(mavlink.MAVLink_mission_request_int_message(SYSID, OURS, len(items), kind))

    def _mission_item_int(self, message):
        if self._upload is None:
            is_last = message.seq == len(self.items[message.mission_type]) - 1
            again = self.acknowledges_again and is_last
            result = mavlink.MAV_MISSION_ACCEPTED if again else mavlink.MAV_MISSION_ERROR
            self._mission_ack_out(result, message.mission_type)
            return
        kind, count, items = self._upload
        if message.seq != len(items):
            self._mission_ack_out(mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)
            return
        items.append(message)
        if len(items) == count:
            self._close()
        else:
            self._ask()

    def _close(self):
        kind, _, items = self._upload
        self.items[kind] = items
        self._upload = None
        self._mission_ack_out(mavlink.MAV_MISSION_ACCEPTED, kind)

    def _mission_ack_out(self, result, kind):
        self.say(mavlink.MAVLink_mission_ack_message(SYSID, OURS, result, kind))

    def _mission_request_list(self, message):
        kind = message.mission_type
        self.say(mavlink.MAVLink_mission_count_message(SYSID, OURS, len(self.items[kind]), kind))

    def _mission_request_int(self, message):
        if message.seq >= len(self.items[message.mission_type]):
            self._mission_ack_out(mavlink.MAV_MISSION_INVALID_SEQUENCE, message.mission_type)
            return
        kept = self.items[message.mission_type][message.seq]
        values = [getattr(kept, name) for name in kept.fieldnames]
        self.say(mavlink.MAVLink_mission_item_int_message(SYSID, OURS, *values[2:]))

    def _mission_clear_all(self, message):
        self.items[message.mission_type] = []
        self._mission_ack_out(mavlink.MAV_MISSION_ACCEPTED, message.mission_type)

    # Parameters.

    def _param_value_out(self, index, name):
        self.say(
            mavlink.MAVLink_param_value_message(
                name.encode(), self.parameters[name], 9, len(self.parameters), index
            )
        )

    def _param_request_list(self, message):
        for index, name in enumerate(self.parameters):
            if index not in self.skip_from_list:
                self._param_value_out(index, name)

    def _param_request_read(self, message):
        if message.param_index >= len(self.parameters):
            return
        if message.param_index >= 0:
            self._param_value_out(message.param_index, list(self.parameters)[message.param_index])
        elif message.param_id in self.parameters:
            self._param_value_out(65535, message.param_id)

    def _param_set(self, message):
        if message.param_id in self.parameters and message.param_id not in self.read_only:
            self.parameters[message.param_id] = message.param_value
        self._param_value_out(65535, message.param_id)

    # Files.

    def _file_transfer_protocol(self, message):
        if not self.ftp:
            return
        payload = bytes(message.payload)
        seq, session, opcode, size, _, _, offset = struct.unpack_from("<HBBBBBxI", payload)
        name = payload[12 : 12 + size]
        if self._answer is not None and (seq + 1) & 0xFFFF == self._answer[0]:
            self._reply(self._answer[0] - 1, *self._answer[1:])
            return
        used, self._file_used = self._file_used, self._time
        if opcode == 4 and used is not None and self._time - used <= IDLE_STEPS:
            self._reply(seq, 0, 129, opcode, 0, bytes([1]))  # one file at a time
        elif opcode == 4 and (found := self._found(name.decode())) is not None:
            self._open, size = found
            self._reply(seq, 3, 128, opcode, 0, struct.pack("<I", size))
        elif opcode == 4:
            self._file_used = None
            self._reply(seq, 0, 129, opcode, 0, bytes([10]))
        elif opcode == 15:
            self._burst(seq, session, offset)
        elif opcode == 1:
            self._file_used = None
            self._reply(seq, session, 128, opcode, 0, b"")

    def _found(self, name):
        """Content of a file and the size that is told of it; of the packed one ArduPilot tells a limit."""
        if name == "@PARAM/param.pck":
            return self.file, 12 * len(self.parameters)
        if name in self.files:
            return self.files[name], self.sizes.get(name, len(self.files[name]))
        return None

    def _burst(self, seq, session, offset):
        """Pieces, the last one said to be so if it is short, and behind it that the file ends, as ArduPilot does it."""
        for number in range(20):
            at = offset + number * PIECE_BYTES
            data = self._open[at : at + PIECE_BYTES]
            if not data:
                self._reply(seq + number, session, 129, 15, at, bytes([6]))
                return
            self._reply(seq + number, session, 128, 15, at, data, len(data) < PIECE_BYTES or number == 19)
        self._answer = (self._answer[0] + 1 & 0xFFFF, *self._answer[1:])

    def _reply(self, seq, session, opcode, asked, offset, data, complete=False):
        self._answer = ((seq + 1) & 0xFFFF, session, opcode, asked, offset, data, complete)
        header = struct.pack(
            "<HBBBBBxI", (seq + 1) & 0xFFFF, session, opcode, len(data), asked, complete, offset
        )
        payload = list((header + data).ljust(251, b"\0"))
        self.say(mavlink.MAVLink_file_transfer_protocol_message(0, SYSID, OURS, payload))


class _Int32Value(mavlink.MAVLink_param_value_message):
    unpacker = struct.Struct("<iHH16sB")


class WholeNumbers(KeepingAutopilot):
    """Parameters that are all int32 and are sent as PX4 does: their four bytes in the place of the float's."""

    def _param_value_out(self, index, name):
        value, count = self.parameters[name], len(self.parameters)
        self.say(_Int32Value(name.encode(), value, 6, count, index))

    def _param_set(self, message):
        (self.parameters[message.param_id],) = struct.unpack_from("<i", message.get_msgbuf(), 10)
        self._param_value_out(65535, message.param_id)


def packed(parameters):
    """ArduPilot's param.pck, all as floats, with every name whole but for what it shares with the one before."""
    content = struct.pack("<HHH", 0x671B, len(parameters), len(parameters))
    before = ""
    for name, value in parameters.items():
        shared = 0
        while shared < min(len(before), len(name) - 1, 15) and before[shared] == name[shared]:
            shared += 1
        rest = name[shared:]
        content += bytes([4, shared | (len(rest) - 1) << 4]) + rest.encode() + struct.pack("<f", value)
        before = name
    return content


class Bench:
    """A real `Vehicle`, its autopilot, and the links between them."""

    def __init__(self, autopilot=None, *, drop=0.0, corrupt=0.0, seed=1, kind=2, mav_autopilot=3):
        self.autopilot = autopilot or KeepingAutopilot()
        self.now_ns = 0
        self.to_autopilot = LossyLink(seed, drop, corrupt)
        self.from_autopilot = LossyLink(seed + 1, drop, corrupt)
        self._framer = Framer()
        self._sent = []
        self.vehicle = Vehicle(SYSID, {}, self._sent.append, lambda: self.now_ns, lambda: None)
        self.commands = self.vehicle.commands
        self.vehicle.link_up()
        self.tell(mavlink.MAVLink_heartbeat_message(kind, mav_autopilot, 0x51, 4, 3, 3))

    def tell(self, message):
        """A message of the autopilot that arrives for sure."""
        (frame,) = Framer().receive(bytes(message.pack(self.autopilot.mav)))
        if self.vehicle.receive(frame, self.now_ns):
            self.vehicle.state_changed(self.now_ns)

    def step(self):
        self.now_ns += STEP_NS
        sent, self._sent[:] = list(self._sent), []
        for frame in sent:
            self.autopilot.hear(self.to_autopilot.carry(frame))
        self.autopilot.step()
        said, self.autopilot.out = self.autopilot.out, []
        for raw in said:
            for frame in self._framer.receive(self.from_autopilot.carry(raw)):
                self.vehicle.receive(frame, self.now_ns)
        self.vehicle.on_time(self.now_ns)

    def run(self, verb, *arguments, steps=60_000, **options):
        """Carry a command out to its end; gives its result."""
        results = []
        self.progress = []
        self.commands.start(
            verb, *arguments, on_progress=self.progress.append, on_done=results.append, **options
        )
        for _ in range(steps):
            if results:
                self.step()  # what is said at the end arrives
                return results[0]
            self.step()
        raise AssertionError(f"{verb} did not end in {steps} steps")

    def heard(self, kind):
        """What the autopilot heard of a type."""
        return [message for message in self.autopilot.heard if message.get_type() == kind]
