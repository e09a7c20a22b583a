"""What the medium knows of each station: where it was, and when its radio was off."""
