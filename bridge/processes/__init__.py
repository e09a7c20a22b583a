"""The processes of a run: radio router, flight dynamics, and per UA its APS daemon and its agent.

Each is started by `bridge.fleet` as ``python -m bridge.processes.NAME --run-dir DIR [--ua ID]``, finds all else in
the run's directory, and shows that it is ready by a liveliness token.
"""
