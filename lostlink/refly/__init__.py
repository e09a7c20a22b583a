"""A recorded run flown again, with its inputs or with others."""
