"""What goes over a bus, made visible: traced to a file, read from it, explained and watched.

``explain`` says packets in words and what is wrong with bad ones; ``traceline``, ``wirelog`` and
``tracing`` write a trace while a bus is served; ``follow`` reads it, ``tally`` adds it up, and
``decoding`` and ``monitor`` show it at a terminal.
"""
