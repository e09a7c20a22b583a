"""Who transmits when: one module per kind of medium, and what they have in common."""
