"""One airframe in JSBSim: what it is made of, where it is, and what its sensors measure."""
