"""The virtual radio: settles every packet of a tick, forwards what survives, and writes the record."""
