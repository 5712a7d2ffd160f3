"""Physics behind the bus: satisfies :mod:`busemu.plant`."""
