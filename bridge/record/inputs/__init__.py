"""What came from outside and took effect: its file, its forms, and radios that were switched."""
