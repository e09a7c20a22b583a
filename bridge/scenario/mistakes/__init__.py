"""What is wrong with a scenario, said with file, line, key and what would be right."""
