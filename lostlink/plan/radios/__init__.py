"""What a scenario asks of its radios: who hears whom, how far, and what keeps a node from transmitting."""
