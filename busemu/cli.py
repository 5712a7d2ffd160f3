"""The command line."""


def main() -> None:
    """Placeholder until the ports stand."""
