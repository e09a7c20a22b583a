"""Where emitters are, from powers measured at known places, and where to measure next; no I/O, no clock."""
