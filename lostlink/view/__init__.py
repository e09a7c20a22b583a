"""The live view: what a browser shows of a run. It reads, and is not on the air."""
