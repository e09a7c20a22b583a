"""A run's radio network on a medium that takes time: moving nodes, their radios' physics, and who transmits when.

link_world  what a frame meets: the run's own links, drawn at the instant of its start
radio_world the same of nodes that stand still, without a run
drawn       frames drawn in one pass
fates       what became of packets, as columns
entry       when a packet enters its radio
instants    of receptions, as columns
network     packets in, receptions with their instants out
"""
