"""What every room stands on: keys, sessions, inboxes, messages, and the directory of the run."""
