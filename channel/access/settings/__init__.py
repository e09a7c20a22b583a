"""The settings of media: what a radio's configuration says of them, checked, and how each is opened."""
