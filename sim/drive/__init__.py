"""One servo drive model: compiled, batched over servos, free of any physics engine."""
