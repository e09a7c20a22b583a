"""The air of a run: what a network can carry, what was offered to it, and how long packets waited."""
