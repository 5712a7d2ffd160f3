"""Ends of the wire: where the bytes of a bus meet a program."""
