"""Links: how bytes come and go."""
