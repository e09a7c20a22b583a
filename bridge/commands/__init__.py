"""The subcommands of `lostlink`, one module each."""
