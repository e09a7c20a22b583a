"""What a scenario will be when it runs: its parts, its radio, what it asks of the radio, and what is left out."""
