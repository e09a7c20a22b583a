"""Fleet time: how far each UA may step, and when; ticks, also over several processes."""
