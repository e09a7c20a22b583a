"""Groups: many nodes written as one, with places in a pattern."""
