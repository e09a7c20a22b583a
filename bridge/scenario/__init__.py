"""What a run is asked to be: the typed scenario, its file, and the objects that it names."""
