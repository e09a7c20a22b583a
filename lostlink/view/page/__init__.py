"""The page that the browser shows, built with NiceGUI."""
