"""What the processes of a run share: its directory, and how they start and end."""
