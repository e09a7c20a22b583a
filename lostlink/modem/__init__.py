"""`lostlink modem`: a pair of telemetry modems between a ground station and an autopilot, in wall time.

live       the link in wall time: moves bytes, arms one timer
report     what came of it, for people and as JSON
plan       from options to the link: a radio and distances, or a recorded run
"""
