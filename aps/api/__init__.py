"""HTTP and WebSocket API of one UA."""
