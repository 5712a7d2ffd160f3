"""The sealed proof: cases with a concealed effect, diagnosed unseen, then opened and scored.

``plan`` (which cases a seed draws), ``writing`` (cases and their published hashes), ``confined``
and ``diagnosing`` (a process that cannot read the keys), ``running`` (all of it, resumable),
``opening`` (the keys, once), ``names`` and ``judging`` (what counts as right), ``scoring``.
The rules stand in docs/proof/rules.md.
"""
