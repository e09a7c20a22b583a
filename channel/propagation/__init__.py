"""Laws of the mean loss between two antennas."""
