"""Many runs as one study: seeds, settings and scenarios, several at a time, and one table of what came of them."""
