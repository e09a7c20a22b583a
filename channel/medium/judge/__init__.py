"""Whether a run's packets are what its radio says."""
