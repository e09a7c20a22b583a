"""Logs of flights: tlog and DataFlash."""
