"""One command from request to result: its plan, the steps that are acknowledged, the setpoints that are repeated."""
