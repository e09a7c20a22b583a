import asyncio
import threading

import pytest

import bridge.program.idle_agents as idle_agents
from bridge.program.idle_agents import IdleAgents


class Agents:
    """Agents' threads that put their names when they may; what was called in the event loop's thread, in order."""

    def __init__(self, idle, names):
        self.idle, self.called, self.at_work = idle, [], 0
        self.may = {name: threading.Event() for name in names}
        self.threads = [threading.Thread(target=self.live, args=(name,)) for name in names]

    def begin(self):
        self.at_work = len(self.threads)
        for thread in self.threads:
            thread.start()

    def live(self, name):
        self.may[name].wait()
        self.idle.put(lambda: self.done(name))

    def done(self, name):
        assert threading.current_thread() is threading.main_thread()
        self.called.append(name)
        self.at_work -= 1


def test_all_agents_of_a_tick_are_waited_for_together():
    async def tick():
        idle = IdleAgents()
        agents = Agents(idle, "abc")
        wakes = 0
        get = idle._wakes.get

        class Counting:
            put = idle._wakes.put

            def get(self, timeout):
                nonlocal wakes
                wakes += 1
                return get(timeout=20.0)

        idle._wakes = Counting()
        for may in agents.may.values():
            threading.Timer(0.01, may.set).start()
        idle.wait(agents.begin, lambda: agents.at_work)
        return sorted(agents.called), wakes

    called, wakes = asyncio.run(tick())
    assert called == ["a", "b", "c"]
    assert wakes <= 1, "the last one wakes the loop, if it waits at all"


def test_an_agent_that_takes_longer_is_called_by_the_event_loop(monkeypatch):
    monkeypatch.setattr(idle_agents, "PATIENCE_S", 0.01)

    async def tick():
        idle = IdleAgents()
        agents = Agents(idle, "ab")
        agents.may["a"].set()
        while_waited = []
        idle.wait(agents.begin, lambda: agents.at_work)
        while_waited += agents.called
        agents.may["b"].set()
        for thread in agents.threads:
            await asyncio.to_thread(thread.join)
        await asyncio.sleep(0)
        return while_waited, agents.called

    while_waited, called = asyncio.run(tick())
    assert "b" not in while_waited
    assert called == ["a", "b"]


def test_what_was_put_is_called_though_the_tick_fails():
    async def tick():
        idle, called = IdleAgents(), []

        def begin():
            idle.put(lambda: called.append("a"))
            raise ArithmeticError

        with pytest.raises(ArithmeticError):
            idle.wait(begin, lambda: 1)
        return called

    assert asyncio.run(tick()) == ["a"]


def test_with_nobody_at_work_nobody_is_waited_for():
    async def tick():
        idle = IdleAgents()
        began = []
        idle.wait(lambda: began.append(True), lambda: 0)
        return began

    assert asyncio.run(tick()) == [True]
