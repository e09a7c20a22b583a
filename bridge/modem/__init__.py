"""Telemetry modems between two serial lines: bytes and instants in, bytes and instants out. Pure: no I/O, no clock.

serial_line  bytes on their way over a line at its baud rate
units        where firmware cuts a stream: MAVLink frames, and runs of other bytes
heard        what radios measure of what they hear
radio_status RADIO_STATUS as firmware fills it in
settings     of a modem: its line, its buffers, its status, by the medium that it is on
modem        one end: serial line, buffers, counters
pair         two of them with the medium between: the whole link
tracks       where the two ends are, over time
radio_link   from a radio to the pair on its links
ideal        the medium of a radio on which packets take no time
"""
