"""Who receives which packet: packets, tracks, links, settling, ledger."""
