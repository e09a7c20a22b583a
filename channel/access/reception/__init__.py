"""What nodes hear of transmissions on a medium: those that overlap, leak in from other channels, or pass."""
