"""Commands that fly, or look at what would be flown."""
