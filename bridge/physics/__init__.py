"""The flight dynamics on the bus: truth and clock."""
