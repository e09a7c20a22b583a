"""Numbers: words of the counter-based generator, special functions, intervals, units."""
