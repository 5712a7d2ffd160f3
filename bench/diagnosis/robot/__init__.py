"""The diagnosis of a whole robot on legs: from recordings of all its joints to a verdict."""
