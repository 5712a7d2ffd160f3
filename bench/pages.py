"""What HTML pages share: templates beside their modules, and a plain style."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from jinja2 import Environment, StrictUndefined, Template

#: of a page of tables and pictures; ``.right`` and its like are colours of words
STYLE = """
:root { color-scheme: light dark; --ink: #22272e; --paper: #fff; --line: #d5d9df; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #dfe3e8; --paper: #15181c; --line: #3a4048; } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 68rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { padding: .2rem .7rem .2rem 0; border-bottom: 1px solid var(--line); text-align: left; }
.great, .right { color: #2e8b57; } .good, .undecided { color: #b58900; }
.no, .wrong { color: #c0392b; }
img { max-width: 100%; background: #fff; } figure { margin: 1.5rem 0; }
figcaption { font-size: 13px; }
"""


@cache
def template(package: str | None, name: str) -> Template:
    """The template of a name in a package's folder; values are escaped, and none may be missing."""
    assert package
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(files(package).joinpath(name).read_text("utf-8"))
