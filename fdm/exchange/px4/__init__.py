"""UA whose autopilot is PX4: it connects by TCP, and its frames are held until it answers or cannot."""
