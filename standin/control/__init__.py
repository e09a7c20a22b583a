"""The control loops: references, attitude, motor commands. They know no MAVLink and no modes."""
