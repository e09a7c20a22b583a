"""What became of each link's packets, by the record."""
