"""Where the live view has a run from: a running simulation or a record."""
