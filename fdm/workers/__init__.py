"""A fleet spread over worker processes."""
