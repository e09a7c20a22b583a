"""The router process: Zenoh's router, and the virtual radio in its session."""
