from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from aps.hub.routing import Router, RoutingOutcome
from aps.wire.framer import Frame

OWN, US, LINKS = 5, 191, range(5)
AUTOPILOT = 0
SMALL = st.sampled_from([0, 1, OWN, 7, 255])
COMPONENTS = st.sampled_from([0, 1, 2, US])


@st.composite
def traffic(draw):
    """(frame, source link, pause before it in ns) in order of arrival."""
    return draw(
        st.lists(
            st.tuples(
                st.builds(
                    lambda msg_id, sysid, compid, system, component: Frame(
                        b"", msg_id, sysid, compid, system, component if system else 0, 10, 0
                    ),
                    st.sampled_from([0, 30, 76, 109, 60_000]),
                    SMALL,
                    COMPONENTS,
                    SMALL,
                    COMPONENTS,
                ),
                st.sampled_from(LINKS),
                st.integers(0, 40),
            ),
            max_size=40,
        )
    )


def routed(frames, expiry_ns=100):
    router = Router(OWN, US, route_expiry_ns=expiry_ns)
    for link in LINKS:
        router.add_link(link, autopilot=link == AUTOPILOT)
    now_ns = 0
    for frame, source, pause_ns in frames:
        now_ns += pause_ns
        yield router, frame, source, now_ns, router.route(frame, source, now_ns)


@given(traffic())
def test_never_back_to_the_source_never_twice_and_only_to_open_links(frames):
    for router, _, source, _, route in routed(frames):
        assert source not in route.links
        assert len(set(route.links)) == len(route.links)
        assert set(route.links) <= set(router.links)


@given(traffic())
def test_every_frame_has_one_outcome(frames):
    seen = [(router, route.outcome) for router, *_, route in routed(frames)]
    for router, _ in seen[-1:]:
        assert router.counters == Counter(outcome for _, outcome in seen)


@given(traffic())
def test_targeted_frames_reach_exactly_the_links_that_have_lately_seen_the_target(frames):
    seen = []  # (instant, link, sysid, compid): the specification, kept as plainly as can be
    for _, frame, source, now_ns, route in routed(frames):
        loop = frame.sysid == OWN and frame.compid == 1 and source != AUTOPILOT
        if not loop and frame.sysid:
            seen.append((now_ns, source, frame.sysid, frame.compid))
        if loop or frame.msg_id in (0, 109) or not frame.target_system:
            continue
        exact = frame.target_system == OWN and frame.target_component
        wanted = {
            link
            for instant, link, sysid, compid in seen
            if now_ns - instant <= 100
            and sysid == frame.target_system
            and (not exact or compid == frame.target_component)
        }
        if frame.target_system == OWN and frame.target_component in (0, 1):
            wanted.add(AUTOPILOT)
        wanted -= {source}
        if not wanted and exact and frame.target_component != US and source != AUTOPILOT:
            wanted = {AUTOPILOT}
        assert set(route.links) == wanted


@given(traffic())
def test_broadcasts_reach_all_other_links(frames):
    for _, frame, source, _, route in routed(frames):
        if route.outcome is RoutingOutcome.BROADCAST:
            assert frame.target_system == 0
            assert set(route.links) == set(LINKS) - {source}
        if frame.msg_id == 109:
            assert route.links == ()
