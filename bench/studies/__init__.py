"""Studies: questions that are put to the whole bench at once, and answered with numbers."""
