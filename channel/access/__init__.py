"""Medium access: who transmits when, for how long and how often, in integer nanoseconds. Pure: no I/O, no clock.

agenda      what happens next, in an order that nothing else decides
packets     what enters a medium, what it puts on the air, and what comes out of it
queue       packets of one node that wait: bounded, with classes, life times and replacement by key
world       how strong a node hears another, and what survives: an interface, and a plain one
air         transmissions on their way to all receivers
receiver    what one node hears of those that overlap, piece by piece
passing     frames that meet no other: past receivers that do not attend to them, as columns
media/      who transmits when: airtime (as soon as it can), csma (IEEE 802.11 DCF), delay (a line per node), elrs
            (ExpressLRS), sik (telemetry radios in pairs; sik_*: its parts), tdma (slots); plain: what two share;
            forecast: when frames of csma are likely to start, so that they are drawn together
elrs_modes  slots and packets of ExpressLRS
stubborn    its stop and wait
timing      how long a frame lasts: 802.11b, 802.11a/g, plain bit rates
words       numbers that are drawn
trial       a medium under load, without a flight
"""
