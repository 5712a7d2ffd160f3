"""The bench: experiments on a bus, recordings of them, and what they tell."""
