"""The child processes of a run: how they are started, in which environment, and how they are ended."""
