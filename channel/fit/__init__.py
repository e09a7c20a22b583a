"""Fitting a radio to a flight log: `read_flight_log`, `fit_radio`, `fitted_radio`."""

from channel.fit.calibration import fit_radio, fitted_radio
from channel.fit.flight_log import FlightLog, read_flight_log
from channel.fit.result import Fit

__all__ = ["Fit", "FlightLog", "fit_radio", "fitted_radio", "read_flight_log"]
