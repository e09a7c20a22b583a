"""Every limit of wall time in a run, in one place, so that they fit each other.

Nothing here decides a result: what flies, flies in sim time. These limits say when something that does not answer is
given up, and whoever waits for another waits longer than the other may take:

    a stuck autopilot is let go (STALL_S) long before the clock is said to stand still (SILENCE_S);
    the start of the autopilots (START_S) ends before the supervisor calls the same silence a failure (SILENCE_S);
    a process that ends has its grace, and one that reports progress (the record of a large run) has more.

Time-outs towards the autopilot (acknowledgements, retries, silence) are sim time and live in `aps`.
"""

from __future__ import annotations

START_S = 60.0
"""For all processes to be ready, and again for the autopilots to send their first packet."""
VIEW_S = 30.0
"""For a view to be served, before the first tick of the run that it is to show; the run then begins without it."""
NEWS_PERIOD_S = 2.0
"""Nothing that a person waits for at a terminal is silent for longer."""
LOG_PERIOD_S = 10.0
"""The same where output goes to a file."""
FLUSH_PERIOD_S = 1.0
"""What was recorded is on disk after that, so that a killed run leaves all but its last second."""
STALL_S = 5.0
"""A UA whose autopilot owes a packet for so long is let go: the others fly on, and the run may not repeat."""
BLOCKED_S = 5.0
"""An agent that is at work on a tick for so long is told to whoever watches: all the run waits for it."""
BLOCKED_LOOK_S = 1.0
"""How often a node looks whether its agent is."""
SILENCE_S = 90.0
"""Without a tick for so long, the run is given up. Longer than START_S, and than STALL_S; with a longer stall in a
scenario (fdm.stall_timeout_s), twice that."""
LOOK_PERIOD_S = 1.0
"""How often the supervisor looks for a tick, and at the sizes of logs."""
LEASE_S = 3600.0
"""A process that is frozen (stopped, swapped out, its machine asleep) keeps its connections for so long, and flies on
when it thaws; Zenoh's 10 s would cut it off for good. Longer than SILENCE_S: the run decides when it is given up."""
LEAVE_S = 0.5
"""For the router to have taken what a client of it published before it leaves."""
AGENT_END_S = 0.5
"""For all agents of a host to end after they were stopped; their records are written in any case."""
OFFSPRING_END_S = 0.5
"""For processes that agents have started to end after they were asked to."""
AGENT_GRACE_S = 2.0
"""For the hosts to end: longer than their agents, what these have started, and their leave may take together."""
FAILURE_GRACE_S = 2.0
"""For a tick in which an agent failed to be closed, so that the run ends with a whole tick."""
FLIGHT_GRACE_S = 1.5
"""For autopilots and physics."""
ROUTER_GRACE_S = 10.0
"""For the radio to say the next word of how far its record is: it may take any time as long as it gets on."""
STACKS_S = 0.2
"""For a process that is to be killed to write to its log what it is at."""
FIRST_STATE_S = 2.0
"""For a script that joins a run to get its node's state: a clock that is held brings none."""
RADIO_ANSWER_S = 10.0
"""For the radio to answer a program beside the run that asks for its next packet."""
COMMAND_QUERY_S = 30 * 86400.0
"""For a script's command: flights end by their own time-outs, in sim time, however long that takes."""
