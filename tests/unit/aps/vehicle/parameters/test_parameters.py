import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.execution import Outcome
from aps.vehicle.parameters.files import compare, read_parameters, write_parameters
from aps.vehicle.parameters.ftp import PACKED_PARAMETERS, ReadExecution, unpacked
from aps.vehicle.parameters.transfer import as_float32, decoded, set_message
from tests.unit.aps.vehicle.peer import SYSID, Bench, KeepingAutopilot, WholeNumbers, packed

_VALUES = np.random.default_rng(5)
PARAMETERS = {
    f"P{n:03}_{'ABCDEFGH'[n % 8] * (n % 5)}X": as_float32(float(_VALUES.uniform(-9.0, 9.0)))
    for n in range(300)
}


@pytest.mark.parametrize("ftp", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_all_parameters_over_a_link_that_loses_and_corrupts(ftp, seed):
    bench = Bench(KeepingAutopilot(PARAMETERS, ftp), drop=0.05, corrupt=0.02, seed=seed)
    result = bench.run("parameters", ftp=ftp)
    assert result.reached, result
    assert result.value == PARAMETERS
    assert bench.from_autopilot.dropped > 0
    assert bool(bench.heard("PARAM_REQUEST_LIST")) is not ftp


class ListingAutopilot(KeepingAutopilot):
    """Sends its list as ArduPilot does: some per step, the count of its beginning, whatever comes in between."""

    def __init__(self, parameters):
        super().__init__(parameters, ftp=False)
        self.at, self.count = None, 0

    def _param_request_list(self, message):
        self.at, self.count = 0, len(self.parameters)

    def step(self):
        super().step()
        for _ in range(20):
            if self.at is not None and self.at < len(self.parameters):
                name = list(self.parameters)[self.at]
                self.say(mavlink.MAVLink_param_value_message(name.encode(), 1.0, 9, self.count, self.at))
                self.at += 1

    def enable(self, names):
        """More parameters, in front of others, as PARAM_SET of an ENABLE makes them."""
        first, *others = self.parameters
        self.parameters = dict.fromkeys([first, *names, *others], 1.0)
        self._param_value_out(0xFFFF, first)


@pytest.mark.parametrize("after", [0, 50, 150])
def test_a_list_that_grows_while_it_is_sent_is_asked_for_anew(after):
    autopilot = ListingAutopilot([(f"P{n}", 1.0) for n in range(200)])
    bench = Bench(autopilot)
    bench.commands.start("parameters", on_done=(ends := []).append)
    while (autopilot.at or 0) < max(after, 1):
        bench.step()
    autopilot.enable([f"GRIP_{n}" for n in range(35)])
    while not ends:
        bench.step()
    assert ends[0].value == autopilot.parameters
    assert len(ends[0].value) == 235
    bench.commands.start("parameters", on_done=ends.append)  # the list before may still be sent
    while len(ends) < 2:
        bench.step()
    assert ends[1].value == autopilot.parameters


def test_a_length_that_changes_for_ever_is_no_list_that_is_asked_for_for_ever():
    autopilot = ListingAutopilot([(f"P{n}", 1.0) for n in range(100)])
    autopilot.step = lambda: autopilot._param_value_out(0xFFFF, "P0")
    autopilot._param_value_out = lambda index, name: autopilot.say(
        mavlink.MAVLink_param_value_message(name.encode(), 1.0, 9, 100 + bench.now_ns // 10**7 % 2, index)
    )
    bench = Bench(autopilot)
    bench.commands.start("parameters", on_done=(ends := []).append)
    while not ends:
        bench.step()
    assert ends[0].outcome is Outcome.TIMED_OUT
    assert len(bench.heard("PARAM_REQUEST_LIST")) < 30


def test_an_autopilot_without_ftp_is_asked_one_by_one():
    bench = Bench(KeepingAutopilot(PARAMETERS, ftp=False))
    result = bench.run("parameters")
    assert result.value == PARAMETERS
    assert bench.now_ns < 5e9  # two questions that nobody answers cost 2 s
    assert bench.progress[0].text.startswith("not by FTP (no answer after 2 tries")


def test_the_file_is_closed_at_the_end():
    bench = Bench(KeepingAutopilot(PARAMETERS))
    assert bench.run("parameters").reached
    opcodes = [message.payload[3] for message in bench.heard("FILE_TRANSFER_PROTOCOL")]
    assert opcodes[0] == 4
    assert opcodes[-1] == 1
    assert set(opcodes[1:-1]) == {15}


def read(bench, path):
    """Read a file to the end; gives the result."""
    reading = ReadExecution(bench.vehicle.telemetry.state(bench.now_ns), path)
    bench.commands.begin(reading, on_done=(ends := []).append)
    while not ends:
        bench.step()
    bench.step()  # what is said at the end arrives
    return ends[0]


def asked_of_files(bench):
    """Opcode and sequence number of each request about files that the autopilot heard."""
    requests = [bytes(message.payload) for message in bench.heard("FILE_TRANSFER_PROTOCOL")]
    return [(payload[3], int.from_bytes(payload[:2], "little")) for payload in requests]


@pytest.mark.parametrize("lost", [1, 2, 7])
def test_a_file_is_read_whose_first_answers_are_lost(lost):
    """A file that is open is not opened twice: the request is the same again, and so is its answer."""
    bench = Bench(KeepingAutopilot(PARAMETERS))
    bench.autopilot.lost["FILE_TRANSFER_PROTOCOL"] = lost
    result = read(bench, PACKED_PARAMETERS)
    assert (result.outcome, result.value) == (Outcome.REACHED, bench.autopilot.file)
    requests = asked_of_files(bench)
    assert [opcode for opcode, _ in requests[: lost + 2]] == [4] * (lost + 1) + [15]
    assert len({seq for _, seq in requests[: lost + 1]}) == 1
    assert len({seq for _, seq in requests}) == len(requests) - lost


@pytest.mark.parametrize("count", [3, 8, 14, 20, 300])
def test_the_request_after_a_burst_is_a_new_one_however_many_pieces_it_had(count):
    """An answer has the number of its request plus one, and each further piece of a burst the next: those are taken."""
    parameters = dict(list(PARAMETERS.items())[:count])
    bench = Bench(KeepingAutopilot(parameters))
    assert bench.run("parameters").value == parameters
    bursts = -(-len(bench.autopilot.file) // 1600)
    requests = asked_of_files(bench)
    assert [opcode for opcode, _ in requests] == [4, *[15] * bursts, 15, 1]
    assert bench.now_ns < 1e9


def test_the_first_answer_to_a_second_file_is_not_the_last_one_to_the_first():
    bench = Bench(KeepingAutopilot(PARAMETERS))
    assert read(bench, "nothing.txt").reason == "nothing.txt: no such file"
    assert read(bench, PACKED_PARAMETERS).value == bench.autopilot.file


CONTENT = _VALUES.bytes(5000)
PATH = "log.bin"


class FileKeeper(KeepingAutopilot):
    """It has one more file, and of its answers about files some do not arrive, or arrive late.

    Args:
        length: of the file, bytes; all of ``CONTENT`` if not given.
        unheard: which answers do not arrive, from 0.
        delay_steps: of all that it says.
    """

    def __init__(self, length=None, unheard=(), delay_steps=0):
        super().__init__(PARAMETERS)
        self.files[PATH] = CONTENT[:length]
        self._unheard, self._delay_steps = unheard, delay_steps
        self._answers = 0
        self._on_the_way = []

    def say(self, message):
        if message.get_type() == "FILE_TRANSFER_PROTOCOL":
            self._answers += 1
            if self._answers - 1 in self._unheard:
                return
        self._on_the_way.append((self._time + self._delay_steps, message))
        self._arrive()

    def step(self):
        super().step()
        self._arrive()

    def _arrive(self):
        while self._on_the_way and self._on_the_way[0][0] <= self._time:
            super().say(self._on_the_way.pop(0)[1])


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("length", [600, 640])
@pytest.mark.parametrize("unheard", [{8}, {9}, {8, 9}, {3, 8, 9}, {7, 8}, {8, 10}])
def test_a_file_is_whole_whose_last_piece_or_its_end_is_lost(unheard, length, told):
    """Its opening is answer 0, its pieces are 1 to 8, and 9 says that it ends."""
    bench = Bench(FileKeeper(length, unheard))
    bench.autopilot.sizes[PATH] = length if told else 0
    result = read(bench, PATH)
    assert (result.outcome, result.value) == (Outcome.REACHED, CONTENT[:length])
    assert bench.now_ns < 4e9
    assert asked_of_files(bench)[-1][0] == 1


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_a_file_that_was_read_is_whole_however_much_is_lost(loss):
    for seed in range(100):
        bench = Bench(FileKeeper(), drop=loss, seed=2 * seed)
        bench.autopilot.sizes[PATH] = 0
        result = read(bench, PATH)
        assert result.value == (CONTENT if result.reached else None), seed
        assert result.reached or loss == 0.3


@pytest.mark.parametrize("delay_steps", [0, 5, 60, 95])
@pytest.mark.parametrize("length", [0, 80, 600, 640, 1600, 5000])
def test_a_file_is_read_from_afar(length, delay_steps):
    """Its end comes behind the answer to which the next request is on its way already."""
    bench = Bench(FileKeeper(length, delay_steps=delay_steps))
    assert read(bench, PATH).value == CONTENT[:length]
    opcodes = [opcode for opcode, _ in asked_of_files(bench)]
    assert opcodes == [4, *[15] * (length // 1600 + 1 + (length % 1600 > 0)), 1]


@pytest.mark.parametrize(
    ("path", "size", "outcome"),
    [
        (PATH, 700, Outcome.REFUSED),
        (PATH, 600, Outcome.REACHED),
        (PATH, 500, Outcome.REACHED),
        (PATH, 0, Outcome.REACHED),
        ("@SYS/tasks.txt", 100_000, Outcome.REACHED),
    ],
)
def test_a_file_has_the_size_that_was_told_at_least(path, size, outcome):
    """It may have grown since; of virtual files ArduPilot tells another one."""
    bench = Bench(FileKeeper())
    bench.autopilot.files[path], bench.autopilot.sizes[path] = CONTENT[:600], size
    result = read(bench, path)
    assert result.outcome is outcome
    if outcome is Outcome.REACHED:
        assert result.value == CONTENT[:600]
    else:
        assert result.reason == "log.bin ends after 600 of 700 bytes"
    assert asked_of_files(bench)[-1][0] == 1


def test_gaps_are_asked_for_by_number():
    autopilot = KeepingAutopilot(PARAMETERS, ftp=False)
    autopilot.skip_from_list = {0, 5, *range(100, 125), 299}
    bench = Bench(autopilot)
    result = bench.run("parameters", ftp=False)
    assert result.value == PARAMETERS
    assert [m.param_index for m in bench.heard("PARAM_REQUEST_READ")] == sorted(autopilot.skip_from_list)
    assert bench.now_ns < 3e9
    assert [(p.done, p.total) for p in bench.progress] == [(100, 300), (200, 300), (300, 300)]


def test_get_and_set():
    bench = Bench(KeepingAutopilot({"RTL_ALT": 1500.0}))
    assert bench.run("parameter_get", "rtl_alt").value == 1500.0
    assert bench.run("parameter_set", "RTL_ALT", 0.1).reached
    assert bench.autopilot.parameters["RTL_ALT"] == as_float32(0.1)
    assert len(bench.heard("PARAM_SET")) == 1


def test_what_is_set_already_is_not_set_again():
    bench = Bench(KeepingAutopilot({"RTL_ALT": 1500.0}))
    assert bench.run("parameter_set", "RTL_ALT", 1500).reached
    assert bench.heard("PARAM_SET") == []


def test_a_value_that_is_not_taken_is_refused_with_the_one_that_is_kept():
    autopilot = KeepingAutopilot({"STAT": 3.0, "RTL_ALT": 1.0})
    autopilot.read_only.add("STAT")
    result = Bench(autopilot).run("parameters_set", {"RTL_ALT": 2.0, "STAT": 4.0})
    assert result.outcome is Outcome.REFUSED
    assert result.reason == "the autopilot keeps STAT at 3 and does not take 4 (1 of 2 are set)"
    assert autopilot.parameters == {"STAT": 3.0, "RTL_ALT": 2.0}


def test_a_parameter_that_does_not_exist():
    result = Bench().run("parameter_get", "NONE")
    assert (result.outcome, result.reason) == (Outcome.TIMED_OUT, "no answer: there may be no parameter NONE")


def test_an_error_of_the_autopilot_is_its_reason():
    bench = Bench()
    bench.commands.start("parameter_get", "NONE", on_done=(ends := []).append)
    bench.autopilot.say(mavlink.MAVLink_param_error_message(7, 191, b"NONE", -1, 1))
    bench.step()
    assert str(ends[0]) == "parameter_get refused: DOES_NOT_EXIST"


def test_whole_numbers_are_kept_whole():
    autopilot = KeepingAutopilot({"N": 1.0})
    autopilot._param_value_out = lambda index, name: autopilot.say(
        mavlink.MAVLink_param_value_message(name.encode(), autopilot.parameters[name], 1, 1, index)
    )
    bench = Bench(autopilot)
    for value in (1.5, 300, -1):
        result = bench.run("parameter_set", "N", value)
        assert result.reason == f"N is a whole number in 0..255: {float(value)!r} is none"
    assert bench.run("parameter_set", "N", 255).reached
    assert bench.heard("PARAM_SET")[0].param_type == 1


def test_what_ardupilots_float_cannot_hold_is_refused_and_not_set_to_the_next():
    """2**31 - 1 would go out as 2**31, which ends a simulated ArduPilot (AP_Param::set_float)."""
    autopilot = KeepingAutopilot({"N": 1.0})
    autopilot._param_value_out = lambda index, name: autopilot.say(
        mavlink.MAVLink_param_value_message(name.encode(), autopilot.parameters[name], 6, 1, index)
    )
    bench = Bench(autopilot)
    for value, sent in ((2**24 + 1, 2**24), (2**31 - 1, 2**31)):
        result = bench.run("parameter_set", "N", value)
        reason = f"N is sent as a four-byte float, which cannot hold {value}: {sent} is next"
        assert (result.outcome, result.reason) == (Outcome.REFUSED, reason)
    assert bench.heard("PARAM_SET") == []
    assert bench.run("parameter_set", "N", 2**24 + 2).reached
    autopilot.parameters["N"] = float(2**24)
    assert bench.run("parameter_set", "N", 2**24 + 1).reached, "as it is told, it is that already"


@pytest.mark.parametrize(
    ("verb", "arguments", "text"),
    [
        ("parameter_get", ("",), "no parameter's name"),
        ("parameter_get", ("RTL ALT",), "no parameter's name"),
        ("parameter_get", ("HÖHE",), "no parameter's name"),
        ("parameters_set", ({"RTL_ALT": 1.0, "HÖHE": 1.0},), "no parameter's name"),
        ("parameter_set", ("RTL_ALT", float("nan")), "must be a number, not nan"),
        ("parameter_set", ("RTL_ALT", 1e300), "too large"),
        ("parameters_set", (["RTL_ALT"],), "names and numbers"),
    ],
)
def test_mistakes_of_the_caller_raise(verb, arguments, text):
    with pytest.raises(ValueError, match=text):
        Bench().commands.start(verb, *arguments)


@pytest.mark.parametrize("kind", [1, 2, 3, 4, 5, 6])
def test_whole_numbers_are_bytes_for_px4_and_floats_for_ardupilot(kind):
    for autopilot, expected in ((12, bytes([100, 0, 0, 0])), (3, struct.pack("<f", 100.0))):
        raw = bytes(set_message(7, "A", 100.0, kind, autopilot).pack(mavlink.MAVLink(None)))
        assert raw[10:14] == expected
        value = {"param_type": kind, "param_value": 100.0, "param_bytes": bytes([100, 0, 0, 0])}
        assert decoded(value, autopilot) == 100.0


@pytest.mark.parametrize("number", [-1, -5_000_000, 2_140_000_000, -(2**31), 2**31 - 1])
def test_no_bit_of_px4s_whole_numbers_is_lost(number):
    """Those of the second and third are a signalling NaN, which a float's conversion makes quiet."""
    bench = Bench(WholeNumbers({"A": number}), mav_autopilot=12)
    assert bench.run("parameter_get", "A").value == number
    assert bench.run("parameter_set", "A", number - 1 if number > 0 else number + 1).reached
    assert bench.autopilot.parameters["A"] == (number - 1 if number > 0 else number + 1)


def test_packed_parameters_with_padding_and_types():
    content = (
        bytes.fromhex("1b6703000300")
        + bytes([1, 0x20]) + b"A_B" + bytes([0xFF])
        + bytes([0, 0, 0])
        + bytes([2, 0x02]) + b"C" + bytes([0x39, 0x30])
        + bytes([0])
        + bytes([0x83, 0x01]) + b"X" + bytes([1, 0, 0, 0])
    )  # fmt: skip
    assert unpacked(content) == {"A_B": -1.0, "A_C": 12345.0, "AX": 1.0}
    assert unpacked(packed(PARAMETERS)) == PARAMETERS


@pytest.mark.parametrize("cut", [0, 3, 7, 9, 50])
def test_a_torn_packed_file_is_an_error(cut):
    with pytest.raises(ValueError, match="packed"):
        unpacked(packed(PARAMETERS)[:cut])


@pytest.mark.parametrize("number", [123456789, 2130706433, 2**31 - 1, -(2**31), 2**32 - 1, 1_000_000])
def test_whole_numbers_of_32_bits_pass_through_files_exactly(number):
    """UXRCE_DDS_AG_IP of PX4 is one: 127.0.0.1."""
    text = write_parameters({"A": float(number)})
    assert text.split() == ["A", str(number)]
    assert compare(read_parameters(text), {"A": float(number)}) == []
    assert compare({"A": float(number - 1)}, {"A": float(number)}) == [("A", number - 1, number)]


def test_parameter_files():
    text = "# saved\nRTL_ALT,1500\nWPNAV_SPEED   500.5 # cm/s\n\n1\t1\tATC_RAT\t0.135\t9\n"
    values = read_parameters(text)
    assert values == {"RTL_ALT": 1500.0, "WPNAV_SPEED": 500.5, "ATC_RAT": 0.135}
    assert read_parameters(write_parameters(PARAMETERS)) == pytest.approx(PARAMETERS, rel=1e-6)
    kept = {name: as_float32(value) for name, value in read_parameters(write_parameters(PARAMETERS)).items()}
    assert kept == PARAMETERS
    assert compare({"A": 0.1, "B": 1.0, "C": 2.0}, {"A": as_float32(0.1), "B": 2.0, "D": 3.0}) == [
        ("B", 1.0, 2.0),
        ("C", 2.0, None),
        ("D", None, 3.0),
    ]
    assert read_parameters("A 1 @READONLY\n") == {"A": 1.0}
    for wrong in ("B", "B 1,500", "B 1 metre"):
        with pytest.raises(ValueError, match="line 2: a name and a value"):
            read_parameters(f"A 1\n{wrong}\n")
    with pytest.raises(ValueError, match=r"line 2: 1e\+39 is too large"):
        read_parameters("A 1\nB 1e39\n")
    with pytest.raises(ValueError, match="line 1: nan is no value"):
        read_parameters("A nan\n")


class RenamedAutopilot(KeepingAutopilot):
    """Answers by its new system id at once, as ArduPilot 4.7 does, and to nothing that is for the one before."""

    def hear(self, frame):
        if self.mav.srcSystem == SYSID:
            super().hear(frame)

    def _param_set(self, message):
        self.parameters[message.param_id] = message.param_value
        if message.param_id in ("MAV_SYSID", "SYSID_THISMAV"):
            self.mav.srcSystem = int(message.param_value)
        if self.answers:
            self._param_value_out(65535, message.param_id)

    answers = True


@pytest.mark.parametrize("name", ["MAV_SYSID", "SYSID_THISMAV"])
def test_a_system_id_is_set_when_the_system_that_has_it_says_so(name):
    bench = Bench(RenamedAutopilot([(name, float(SYSID))]))
    assert bench.run("parameter_set", name, 9.0).reached
    assert bench.now_ns < 1e9
    assert bench.progress[-1].text == f"{name} is set"


def test_what_is_set_after_the_system_id_is_not():
    bench = Bench(RenamedAutopilot([("A", 1.0), ("MAV_SYSID", float(SYSID)), ("Z", 1.0)]))
    result = bench.run("parameters_set", {"A": 2.0, "MAV_SYSID": 9.0, "Z": 2.0})
    assert str(result) == (
        "parameters_set interrupted: the autopilot calls itself system 9 now (2 of 3 are set)"
    )


def test_a_system_id_without_an_answer_may_be_set():
    autopilot = RenamedAutopilot([("MAV_SYSID", float(SYSID))])
    autopilot.answers = False
    result = Bench(autopilot).run("parameter_set", "MAV_SYSID", 9.0)
    assert str(result) == (
        "parameter_set timed out: no answer: MAV_SYSID is set if the autopilot calls itself system 9 now"
    )


def test_another_systems_parameter_is_not_taken_for_ours():
    """One that is called 9 already is not ours: ours is not set before it was asked to be."""
    bench = Bench(KeepingAutopilot([("MAV_SYSID", float(SYSID))]))
    bench.commands.start("parameter_get", "MAV_SYSID", on_done=(ends := []).append)
    bench.autopilot.mav.srcSystem = 9
    bench.tell(mavlink.MAVLink_param_value_message(b"MAV_SYSID", 9.0, 9, 1, 0))
    assert ends == []
