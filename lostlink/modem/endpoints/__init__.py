"""Where a modem's host is: `open_endpoint` by address.

endpoint   what all have in common
tcp        a connection that is made again, or a port that listens
udp        a port to send to, or one that waits for whoever sends
line       a pseudo-terminal, or a serial line
address    ``KIND:PLACE``, read and checked
"""
