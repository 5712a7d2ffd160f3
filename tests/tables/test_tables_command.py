"""``busemu tables``: the command that prints control tables."""

from programs import busemu


def tables(*words):
    return busemu("tables", *words)


def test_without_a_model_it_lists_them():
    assert "XM430-W350" in tables().stdout.splitlines()


def test_with_a_model_it_prints_the_table():
    printed = tables("AX-12A")
    assert printed.returncode == 0
    assert "| 36 | 2 | `present_position` | R |" in printed.stdout


def test_an_unknown_model_is_one_clear_line():
    refused = tables("AX-13")
    assert refused.returncode == 1
    assert refused.stderr.count("\n") == 1
    assert "AX-12A" in refused.stderr
