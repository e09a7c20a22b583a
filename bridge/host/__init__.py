"""What runs on board, in one process: the aircraft bridges and agents of one or several UA, tick by tick."""
