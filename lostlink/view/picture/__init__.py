"""What the live view knows of a run, and what of it a browser is sent."""
