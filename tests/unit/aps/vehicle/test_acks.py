from aps.timeouts import OWED_HEARTBEATS
from aps.vehicle.acks import FOREIGN, MAX_OWED, AckLedger

MODE, ARM = 176, 400
US, STATION = (2, 191), (255, 190)


def test_acknowledgements_answer_in_the_order_of_sending():
    ledger = AckLedger()
    for command, request in ((MODE, "a"), (ARM, "b"), (MODE, "c")):
        ledger.sent(command, *US, request)
    assert ledger.answered(MODE, *US) == "a"
    assert ledger.answered(MODE, *US) == "c"
    assert ledger.answered(MODE, *US) is None
    assert ledger.answered(ARM, *US) == "b"
    assert len(ledger) == 0


def test_each_try_is_owed_an_acknowledgement_of_its_own():
    ledger = AckLedger()
    for request in ("first", "first", "second"):
        ledger.sent(MODE, *US, request)
    assert [ledger.answered(MODE, *US) for _ in range(3)] == ["first", "first", "second"]


def test_in_progress_announces_another_answer_however_late():
    ledger = AckLedger()
    ledger.sent(MODE, *US, "a")
    assert ledger.answered(MODE, *US, final=False) == "a"
    for _ in range(30):
        ledger.heartbeat()
    assert ledger.answered(MODE, *US) == "a"


def test_whom_it_is_for_decides_if_it_is_told_and_the_order_if_not():
    ledger = AckLedger()
    ledger.sent(MODE, *STATION, FOREIGN)
    ledger.sent(MODE, *US, "ours")
    assert ledger.answered(MODE, *US) == "ours"
    ledger.sent(MODE, *US, "ours")
    assert ledger.answered(MODE, 0, 0) is FOREIGN
    assert ledger.answered(MODE, 0, 0) == "ours"


def test_what_is_not_there_after_some_heartbeats_will_not_come():
    ledger = AckLedger()
    ledger.sent(MODE, *US, "lost")
    for _ in range(OWED_HEARTBEATS - 1):
        ledger.heartbeat()
    ledger.sent(MODE, *US, "new")
    ledger.heartbeat()
    assert ledger.answered(MODE, *US) == "new"
    assert ledger.counters.given_up == 1


def test_a_new_connection_owes_nothing():
    ledger = AckLedger()
    ledger.sent(MODE, *US, "a")
    ledger.forget()
    assert ledger.answered(MODE, *US) is None


def test_memory_is_bounded():
    ledger = AckLedger()
    for number in range(3 * MAX_OWED):
        ledger.sent(MODE, *STATION, number)
    assert len(ledger) == MAX_OWED
    assert ledger.answered(MODE, *STATION) == 2 * MAX_OWED
    assert ledger.counters.given_up == 2 * MAX_OWED
