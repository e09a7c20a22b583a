"""The exchange: sockets and a loop around the sans-IO parts."""
