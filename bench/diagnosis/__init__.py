"""Finding what a simulation of a servo left out, from recordings of the real one."""
