"""Tables for thousands of links at once: curves at an even step, error rates, lengths, steps."""
