"""The command ``busemu fault``: let something go wrong on a bus that is being served."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from .cli import fail
from .control import ControlError, ask
from .faults import Kind
from .wording import amount

_KINDS = ", ".join(kind.value.replace("_", "-") for kind in Kind)


def fault(
    what: Annotated[str, typer.Argument(metavar="KIND|list|clear", help=f"{_KINDS}; list; clear.")],
    which: Annotated[
        str | None,
        typer.Argument(
            metavar="[NUMBER|KIND]", help="With clear: what to end. Default: all faults."
        ),
    ] = None,
    servo: Annotated[
        list[int] | None, typer.Option(help="Strike this servo only; may be given several times.")
    ] = None,
    register: Annotated[
        str | None, typer.Option(help="Strike packets about this register only.")
    ] = None,
    instruction: Annotated[
        str | None, typer.Option(help="Strike this instruction only: ping, read, sync_read ...")
    ] = None,
    on: Annotated[
        str | None, typer.Option(help="reply (the default) or instruction: which way it strikes.")
    ] = None,
    count: Annotated[int | None, typer.Option(help="Strike so often, then no more.")] = None,
    probability: Annotated[
        float | None, typer.Option(help="Strike this share of the packets, 0 to 1.")
    ] = None,
    after_s: Annotated[float | None, typer.Option(help="Begin so much later [s].")] = None,
    for_s: Annotated[float | None, typer.Option(help="Last so long [s].")] = None,
    delay_s: Annotated[float | None, typer.Option(help="delay, latency: so much [s].")] = None,
    gap_s: Annotated[float | None, typer.Option(help="split: a pause of so much [s].")] = None,
    bits: Annotated[int | None, typer.Option(help="corrupt: flip so many bits.")] = None,
    bytes_: Annotated[
        int | None,
        typer.Option("--bytes", help="truncate: so many are left. noise: so many come before."),
    ] = None,
    temperature_c: Annotated[
        float | None, typer.Option(help="overheat: what the sensor says [°C].")
    ] = None,
    id_: Annotated[int | None, typer.Option("--id", help="duplicate-id: the wrong ID.")] = None,
    port: Annotated[
        str | None,
        typer.Option(help="The server's port or link. Default: the only server there is."),
    ] = None,
) -> None:
    """Let something go wrong on a running bus.

    With busemu serve --robot marvin --link /tmp/marvin in another shell:

        busemu fault drop --servo 3 --count 5

        busemu fault corrupt --instruction sync_read --probability 0.02

        busemu fault unplug --for-s 2

        busemu fault list

        busemu fault clear

    A fault lasts until it is cleared, unless --count or --for-s end it. What strikes shows in the
    trace: busemu serve --trace FILE, busemu monitor FILE. For faults from the start, and for runs
    that repeat, write them into a file: busemu serve --faults FILE.
    """
    fields: dict[str, Any] = {
        "servo": servo,
        "register": register,
        "instruction": instruction,
        "on": on,
        "count": count,
        "probability": probability,
        "after_s": after_s,
        "for_s": for_s,
        "delay_s": delay_s,
        "gap_s": gap_s,
        "bits": bits,
        "bytes": bytes_,
        "temperature_c": temperature_c,
        "id": id_,
    }
    given = {key: value for key, value in fields.items() if value is not None}
    if given and what in ("list", "clear"):
        fail(f"{what} takes no {', '.join('--' + key.replace('_', '-') for key in given)}")
    if which is not None and what != "clear":
        fail(f"{which!r} says nothing here: what to strike is given with --servo and the like")
    if what == "list":
        _show(_ask(port, {"do": "list"})["faults"])
    elif what == "clear":
        number = int(which) if which is not None and which.isdecimal() else which
        ended = _ask(port, {"do": "clear", "which": number})["ended"]
        typer.echo(f"ended {amount(ended, 'fault')}")
    else:
        answer = _ask(port, {"do": "add", "fault": {"kind": what, **given}})
        typer.echo(f"fault {answer['number']}: {answer['words']}")


def _ask(port: str | None, request: dict[str, Any]) -> dict[str, Any]:
    try:
        answer = ask(port, request)
    except ControlError as error:
        fail(error)
    if "error" in answer:
        fail(answer["error"])
    return answer


def _show(faults: list[dict[str, Any]]) -> None:
    if not faults:
        typer.echo("no faults; busemu fault drop --servo 3 --count 5 would be one")
        return
    typer.echo("number  state    struck  fault")
    for each in faults:
        typer.echo(f"{each['number']:6}  {each['state']:7}  {each['struck']:6}  {each['words']}")
