"""A whole run as one program: its parts in one process, joined by calls, and the bus beside them if it is wanted."""
