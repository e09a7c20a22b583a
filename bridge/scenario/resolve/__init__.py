"""From what a scenario names to the objects of flight dynamics and channel."""
