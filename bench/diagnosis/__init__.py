"""Finding what a simulation of a servo left out, from recordings of the real one.

``joint`` diagnoses one joint, ``robot`` a robot on legs as a whole, and ``report`` shows either.
What both stand on is beside them: what was observed, how it scatters (``noise``), the knobs that
are turned, and the result; ``running`` and ``replaying`` are what the commands call.
"""
