"""One link: budget, probability of delivery, decision."""
