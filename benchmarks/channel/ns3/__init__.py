"""IEEE 802.11 DCF by ns-3 and by lostlink, in the same settings."""
