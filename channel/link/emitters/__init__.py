"""Emitters, and what they and other radios add at a receiver."""
