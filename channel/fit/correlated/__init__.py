"""Fitting a radio whose shadowing is correlated along the track."""
