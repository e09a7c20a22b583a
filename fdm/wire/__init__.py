"""What goes over UDP: servo packets in, sensor frames out, and which frame a packet asks for."""
