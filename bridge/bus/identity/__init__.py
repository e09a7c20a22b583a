"""Who may do what on Zenoh: the table of rights, the identities of a run, their passwords, and the router's rules."""
