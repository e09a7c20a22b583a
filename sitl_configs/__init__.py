"""What ships to be chosen by name, and the base of what such files say."""
