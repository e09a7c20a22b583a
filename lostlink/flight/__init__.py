"""One run from its first process to its summary: what commands, scripts and studies fly."""
