"""Who receives which packet: tracks, settling, ledger."""
