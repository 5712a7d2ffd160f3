"""A figure an experiment, laid out as the thesis's."""
