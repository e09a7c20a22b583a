"""Classes and functions of the user's own that a scenario names, looked at without running their code."""
