"""Where a modem's host is, for `lostlink modem` and for ground nodes of a run: `address.endpoint_of` by its text.

endpoint   what all have in common
tcp        a connection that is made again, or a port that listens
udp        a port to send to, or one that waits for whoever sends
line       a pseudo-terminal, or a serial line
address    ``KIND:PLACE``, read and checked
"""
