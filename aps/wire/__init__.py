"""MAVLink on the wire: message tables, framing."""
