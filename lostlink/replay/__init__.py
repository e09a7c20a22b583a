"""A record read back: played tick by tick as the run was."""
