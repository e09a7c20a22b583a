"""Recorded transmissions decided anew: by another radio, another seed, or the same."""
