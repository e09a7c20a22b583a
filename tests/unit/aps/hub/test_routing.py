import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.hub.routing import MAX_LEARNED, MAX_OWN, Router, RoutingOutcome
from aps.wire.framer import Framer

AUTOPILOT, ALICE, BOB, CAROL, SECOND = 0, 1, 2, 3, 4
S = 1_000_000_000


def frame_of(message, sysid, compid):
    mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    (frame,) = Framer().receive(bytes(message.pack(mav)))
    return frame


def heartbeat(sysid, compid):
    return frame_of(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), sysid, compid)


def attitude(sysid=5, compid=1, time_ms=1):
    return frame_of(mavlink.MAVLink_attitude_message(time_ms, 0, 0, 0, 0, 0, 1), sysid, compid)


def command(target_system, target_component, sysid=255, compid=190):
    message = mavlink.MAVLink_command_long_message(target_system, target_component, 400, 0, *[0] * 6, 1)
    return frame_of(message, sysid, compid)


@pytest.fixture
def router():
    router = Router(sysid=5, compid=191, route_expiry_ns=60 * S)
    router.add_link(AUTOPILOT, autopilot=True)
    for link in (ALICE, BOB, CAROL):
        router.add_link(link)
    return router


def test_telemetry_goes_to_all_but_its_source(router):
    route = router.route(attitude(), AUTOPILOT, 0)
    assert (route.outcome, route.links, route.to_us) == (RoutingOutcome.BROADCAST, (ALICE, BOB, CAROL), True)


def test_broadcast_of_a_client_goes_to_the_autopilot_and_the_other_clients(router):
    assert router.route(command(0, 0), BOB, 0).links == (AUTOPILOT, ALICE, CAROL)


@pytest.mark.parametrize("component", [0, 1])
def test_command_for_the_autopilot_goes_there_alone_even_before_it_has_spoken(router, component):
    route = router.route(command(5, component), ALICE, 0)
    assert (route.outcome, route.links) == (RoutingOutcome.TARGETED, (AUTOPILOT,))
    assert route.to_us == (component == 0)


def test_own_component_goes_to_links_that_have_seen_it_and_else_to_the_autopilot(router):
    assert router.route(command(5, 154), ALICE, 0).links == (AUTOPILOT,)  # which decides
    router.route(attitude(5, 154), BOB, 1)
    assert router.route(command(5, 154), ALICE, 2).links == (BOB,)
    assert router.route(command(5, 155), ALICE, 2).links == (AUTOPILOT,)
    assert router.route(command(5, 155, sysid=5, compid=1), AUTOPILOT, 2).outcome is RoutingOutcome.NO_ROUTE


def test_foreign_system_goes_to_links_that_have_seen_it_whatever_the_component(router):
    router.route(heartbeat(255, 190), ALICE, 0)
    router.route(heartbeat(254, 1), BOB, 0)
    answer = router.route(command(255, 77, sysid=5, compid=1), AUTOPILOT, 1)
    assert (answer.outcome, answer.links, answer.to_us) == (RoutingOutcome.TARGETED, (ALICE,), False)
    assert router.route(command(253, 0, sysid=5, compid=1), AUTOPILOT, 1).outcome is RoutingOutcome.NO_ROUTE


def test_never_back_to_the_source(router):
    router.route(heartbeat(255, 190), ALICE, 0)
    route = router.route(command(255, 190, sysid=254), ALICE, 1)
    assert (route.outcome, route.links) == (RoutingOutcome.NO_ROUTE, ())


def test_for_ourselves_alone_is_not_passed_on(router):
    route = router.route(command(5, 191), ALICE, 0)
    assert (route.outcome, route.links, route.to_us) == (RoutingOutcome.LOCAL, (), True)


def test_heartbeat_skips_links_that_already_reach_its_sender(router):
    assert router.route(heartbeat(255, 190), ALICE, 0).links == (AUTOPILOT, BOB, CAROL)
    router.route(attitude(255, 190), BOB, 1)  # the same station on a second link
    assert router.route(heartbeat(255, 190), ALICE, 2).links == (AUTOPILOT, CAROL)
    assert router.route(heartbeat(255, 191), ALICE, 2).links == (AUTOPILOT, BOB, CAROL)


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7),
        mavlink.MAVLink_radio_message(1, 2, 3, 4, 5, 6, 7),
    ],
)
def test_radio_status_is_never_forwarded(router, message):
    route = router.route(frame_of(message, 51, 68), AUTOPILOT, 0)
    assert (route.outcome, route.links, route.to_us) == (RoutingOutcome.LINK_LOCAL, (), True)


def test_unknown_message_is_routed(router):
    from fastcrc.crc16 import mcrf4xx

    body = bytes([2, 0, 0, 0, 5, 1]) + (60_000).to_bytes(3, "little") + b"ab"
    (frame,) = Framer(trusting=True).receive(b"\xfd" + body + mcrf4xx(body + b"\x07").to_bytes(2, "little"))
    assert router.route(frame, AUTOPILOT, 0).links == (ALICE, BOB, CAROL)


def test_the_autopilots_own_frames_from_a_client_are_a_loop(router):
    for frame in (attitude(5, 1), heartbeat(5, 1)):
        assert router.route(frame, ALICE, 0) == (RoutingOutcome.LOOP, (), False)
    assert not router.knows(ALICE, 5, 1, 0)


def test_our_own_frames_that_come_back_are_a_loop_and_those_of_a_companion_with_our_ids_are_not(router):
    ours, theirs = heartbeat(5, 191), attitude(5, 191)
    router.sent(ours.raw)
    for link in (AUTOPILOT, ALICE):
        assert router.route(ours, link, 0) == (RoutingOutcome.LOOP, (), False)
    assert router.route(theirs, ALICE, 0).links == (AUTOPILOT, BOB, CAROL)
    answer = router.route(command(5, 191, sysid=5, compid=1), AUTOPILOT, 1)
    assert (answer.outcome, answer.links, answer.to_us) == (RoutingOutcome.TARGETED, (ALICE,), True)


def test_the_memory_of_our_own_frames_is_bounded(router):
    frames = [attitude(5, 191, number) for number in range(2 * MAX_OWN)]
    for frame in frames:
        router.sent(frame.raw)
    loops = sum(router.route(frame, ALICE, 0).outcome is RoutingOutcome.LOOP for frame in frames)
    assert loops == MAX_OWN


def test_a_second_link_to_the_autopilot_stands_by(router):
    router.add_link(SECOND, autopilot=True)
    assert router.primary == AUTOPILOT
    assert router.route(attitude(), AUTOPILOT, 0).links == (ALICE, BOB, CAROL)
    for frame in (attitude(), heartbeat(5, 1)):
        assert router.route(frame, SECOND, 0) == (RoutingOutcome.STANDBY, (), True)
    assert router.route(command(5, 1), ALICE, 0).links == (AUTOPILOT,)
    assert router.route(command(0, 0), ALICE, 0).links == (AUTOPILOT, BOB, CAROL)
    router.use(SECOND)
    assert router.route(attitude(), SECOND, 1).links == (ALICE, BOB, CAROL)
    assert router.route(command(5, 1), ALICE, 1).links == (SECOND,)
    router.remove_link(SECOND)
    assert router.primary == AUTOPILOT
    with pytest.raises(ValueError, match="link 1 is no autopilot's"):
        router.use(ALICE)


def test_routes_expire_after_silence(router):
    router.route(heartbeat(255, 190), ALICE, 0)
    assert router.route(command(255, 0, sysid=5, compid=1), AUTOPILOT, 60 * S).links == (ALICE,)
    late = 60 * S + 1
    assert (
        router.route(command(255, 0, sysid=5, compid=1), AUTOPILOT, late).outcome is RoutingOutcome.NO_ROUTE
    )
    router.expire(late)
    assert not router.knows(ALICE, 255, 190, 0)


def test_a_frame_renews_its_route(router):
    for now in (0, 50 * S, 100 * S):
        router.route(heartbeat(255, 190), ALICE, now)
    assert router.route(command(255, 0, sysid=5, compid=1), AUTOPILOT, 150 * S).links == (ALICE,)


def test_a_closed_links_routes_go_at_once(router):
    router.route(heartbeat(255, 190), ALICE, 0)
    router.remove_link(ALICE)
    assert router.links == (AUTOPILOT, BOB, CAROL)
    assert router.route(command(255, 0, sysid=5, compid=1), AUTOPILOT, 1).outcome is RoutingOutcome.NO_ROUTE
    assert router.route(attitude(), AUTOPILOT, 1).links == (BOB, CAROL)


def test_learned_routes_are_bounded(router):
    for number in range(3 * MAX_LEARNED):
        router.route(attitude(6 + number % 240, number // 240), ALICE, number)
    known = sum(
        router.knows(ALICE, sysid, compid, 3 * MAX_LEARNED)
        for sysid in range(1, 256)
        for compid in range(256)
        if sysid != 5
    )
    assert known == MAX_LEARNED


def test_system_zero_is_not_learned(router):
    router.route(attitude(0, 1), ALICE, 0)
    assert not router.knows(ALICE, 0, 1, 0)


def test_each_frame_has_one_outcome(router):
    frames = [attitude(), heartbeat(5, 1), command(5, 191), command(77, 0), attitude(5, 191)]
    router.sent(frames[-1].raw)
    for frame in frames:
        router.route(frame, AUTOPILOT, 0)
    assert router.counters == {
        RoutingOutcome.BROADCAST: 1,
        RoutingOutcome.HEARTBEAT: 1,
        RoutingOutcome.LOCAL: 1,
        RoutingOutcome.NO_ROUTE: 1,
        RoutingOutcome.LOOP: 1,
    }


def test_mistakes_of_the_caller_raise(router):
    with pytest.raises(ValueError, match="already open"):
        router.add_link(ALICE)
    with pytest.raises(ValueError, match="route_expiry_ns must be positive, not 0"):
        Router(1, 191, route_expiry_ns=0)


def test_what_is_heard_on_both_links_to_the_autopilot_is_forwarded_once(router):
    router.add_link(SECOND, autopilot=True)
    gimbal = attitude(5, 154)
    assert router.route(gimbal, SECOND, 0).outcome is RoutingOutcome.BROADCAST  # heard there alone
    assert router.route(gimbal, AUTOPILOT, 1).links == (ALICE, BOB, CAROL)
    for frame in (gimbal, heartbeat(5, 154)):
        assert router.route(frame, SECOND, 2) == (RoutingOutcome.STANDBY, (), True)
    assert router.route(gimbal, SECOND, 61 * S).outcome is RoutingOutcome.BROADCAST


def test_a_key_goes_to_its_target_and_to_nobody_else(router):
    def key_for(system, component):
        return frame_of(mavlink.MAVLink_setup_signing_message(system, component, bytes(32), 1), 255, 190)

    assert router.route(key_for(0, 0), ALICE, 0).links == ()
    assert router.route(key_for(5, 1), ALICE, 0).links == (AUTOPILOT,)
