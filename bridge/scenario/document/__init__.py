"""The text of a scenario: its values, each with where it was written; merged with others and changed by settings."""
