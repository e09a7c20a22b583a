"""A record on Zenoh: keys and messages that the run had, and of these only what somebody subscribes to."""

from __future__ import annotations

from collections.abc import Callable

from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus, Header, Message
from bridge.bus.session import Session, Stamp
from bridge.record.logged import as_json
from bridge.scenario.model import Scenario
from lostlink.replay.moment import Moment
from lostlink.replay.playing.pace import Pace


class MomentPublisher:
    """Publishes moments.

    Args:
        session: of a router, or a client of one that lets it write.
        keys: under which prefix.
        scenario: of the run.
    """

    def __init__(self, session: Session, keys: Keys, scenario: Scenario) -> None:
        self._session = session
        self._keys = keys
        self._waits = False
        nodes = scenario.transceiver_ids
        self._wants_truth = self._interests(scenario.stations, keys.truth)
        self._wants_state = self._interests(nodes, keys.state)
        self._wants_rx = self._interests(nodes, lambda node: keys.rx(node, "*", "*"))
        self._wants_status = self._interests(nodes, keys.comm_status)
        self._wants_report = self._interests(nodes, keys.agent)
        self._wants_measurements = self._interests(nodes, keys.measurements)
        self._wants_logged = self._interests(nodes, lambda node: keys.logged(node, "*"))
        records = ("truths", "fates", "communication", "links")
        self._wants_tick = self._interests(records, keys.tick)

    def _interests(
        self, names: tuple[str, ...] | list[str], key: Callable[[str], str]
    ) -> dict[str, Callable[[], bool]]:
        return {name: self._session.interest(key(name)) for name in names}

    def publish(self, moment: Moment, pace: Pace, *, everything: bool = False) -> None:
        """Publish a moment in the order in which a run does.

        Args:
            moment: the player's present one.
            pace: how it is played.
            everything: also what is not due at this tick: after a jump.
        """
        self._waits = pace.speed == float("inf")
        self._truths(moment)
        self.clock(moment, pace)
        self._states(moment, everything=everything)
        self._received(moment)
        self._statuses(moment)
        self._measured(moment)
        self._logged(moment)
        if not moment.is_last:  # which ends a run in its place
            header = Header.at(moment.sim_time_ns, "")
            self._session.put(self._keys.clock_release, header, must_arrive=True)
        self._observed(moment, everything=everything)

    def clock(self, moment: Moment, pace: Pace) -> None:
        """Publish the clock alone: while the record is paused, so that it is seen to be."""
        clock = moment.clock(pace.speed, pace.real_time_factor, paused=pace.paused)
        self._session.put(self._keys.clock, clock, must_arrive=True)

    def end(self, moment: Moment) -> None:
        """Say that the record ends with this moment."""
        self._session.put(self._keys.clock_end, Header.at(moment.sim_time_ns, ""), must_arrive=True)

    def _put(self, key: str, message: Message) -> None:
        """Who only looks on may miss something, unless it is played as fast as can be: then it is waited for."""
        self._session.put(key, message, must_arrive=self._waits)

    def _truths(self, moment: Moment) -> None:
        wanted = [node for node, wants in self._wants_truth.items() if wants()]
        if wanted:
            truth = moment.truth()
            for node in wanted:
                if node in truth:
                    self._put(self._keys.truth(node), truth[node])
        if self._wants_tick["truths"]():
            self._session.put(self._keys.tick("truths"), moment.truths(), must_arrive=True)

    def _states(self, moment: Moment, *, everything: bool) -> None:
        wanted = [node for node, wants in self._wants_state.items() if wants()]
        for node, state in moment.states(wanted).items() if wanted else ():
            if everything or state.header.stamp.ns == moment.sim_time_ns:
                self._put(self._keys.state(node), state)

    def _received(self, moment: Moment) -> None:
        wanted = [node for node, wants in self._wants_rx.items() if wants()]
        for packet in moment.received(wanted) if wanted else ():
            self._session.put_bytes(
                self._keys.rx(packet.rx, packet.tx, packet.channel),
                packet.payload,
                encoding=packet.encoding,
                attachment=packet.attachment,
                must_arrive=True,
            )

    def _statuses(self, moment: Moment) -> None:
        if not any(wants() for wants in self._wants_status.values()):
            return
        for status in moment.statuses():
            node = status.header.frame_id
            if self._wants_status[node]():
                self._session.put(self._keys.comm_status(node), status, must_arrive=True)

    def _measured(self, moment: Moment) -> None:
        if not any(wants() for wants in self._wants_measurements.values()):
            return
        for node, message in moment.measurements():
            if self._wants_measurements[node]():
                self._session.put(self._keys.measurements(node), message, must_arrive=True)

    def _logged(self, moment: Moment) -> None:
        if not any(wants() for each in (self._wants_report, self._wants_logged) for wants in each.values()):
            return
        for node, sim_time_ns, item in moment.logged():
            if isinstance(item, AgentStatus):
                if self._wants_report[node]():
                    self._session.put(self._keys.agent(node), item, must_arrive=True)
            elif self._wants_logged[node]():
                self._session.put_bytes(
                    self._keys.logged(node, item.name),
                    as_json(item.value).encode(),
                    encoding="application/json",
                    attachment=Stamp(-1, sim_time_ns).to_bytes(),
                    must_arrive=self._waits,
                )

    def _observed(self, moment: Moment, *, everything: bool) -> None:
        if self._wants_tick["fates"]() and moment.has_fates:
            self._put(self._keys.tick("fates"), moment.fates())
        if self._wants_tick["communication"]():
            self._put(self._keys.tick("communication"), moment.communication())
        if (moment.links_are_due or everything) and self._wants_tick["links"]():
            self._put(self._keys.tick("links"), moment.links())
