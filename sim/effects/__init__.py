"""The catalogue: physics that can be switched on, one file an effect.

Each module of this folder, except ``effect`` and ``__main__``, defines one ``EFFECT``; a new file
is a new effect.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from types import MappingProxyType

from ..entries import PhysicsError
from .effect import Effect, Group, Parameter, Scope

__all__ = ["Effect", "Group", "Parameter", "Scope", "catalogue", "effect"]


@cache
def catalogue() -> MappingProxyType[str, Effect]:
    """All effects by name, sorted."""
    found = (module.name for module in pkgutil.iter_modules(__path__))
    names = sorted(name for name in found if name not in ("effect", "__main__"))
    modules = [importlib.import_module(f"{__name__}.{name}") for name in names]
    return MappingProxyType({module.EFFECT.name: module.EFFECT for module in modules})


def effect(name: str) -> Effect:
    """An effect by its name. Raises :class:`sim.entries.PhysicsError`."""
    try:
        return catalogue()[name]
    except KeyError:
        raise PhysicsError(
            f"no effect named {name!r}: use one of {', '.join(catalogue())}"
        ) from None
