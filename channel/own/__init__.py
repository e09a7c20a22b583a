"""Models of the user's own: how they are found, and what their methods are held to."""
