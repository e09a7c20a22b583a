"""How an agent runs: its thread, its loop of sim time, and what it is fed."""
