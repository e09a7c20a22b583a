"""Parameters: one, all, from files, and over MAVLink FTP."""
