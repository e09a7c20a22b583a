"""The pages: one file each, that asks for nothing."""
