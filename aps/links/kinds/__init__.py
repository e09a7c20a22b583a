"""The kinds of links: TCP, UDP, serial lines, and autopilots that are held or called."""
