"""What a run shows, as numbers, pictures and one page; runs side by side."""
