"""``python -m bench.blind --seed N --out DIR``: write sealed cases, to look at or to diagnose."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import track

from .case import Asked, Concealment, Kind
from .cases import write_case
from .effects import EFFECTS
from .legged_case import READS
from .rigs import RIGS, STYLES
from .scenes import SCENES
from .unlisted import STRANGERS

app = typer.Typer(add_completion=False)


def _secret(path: Path) -> str:
    """The secret in a file; made, readable by its owner alone, where there is none."""
    if not path.exists():
        path.touch(mode=0o600)
        path.write_text(secrets.token_urlsafe(32) + "\n", "utf-8")
    return path.read_text("utf-8").strip()


@app.command()
def main(
    seed: Annotated[int, typer.Option(help="The first case's seed; the next have the next.")],
    out: Annotated[Path, typer.Option(help="Folder for the case folders.")],
    count: Annotated[int, typer.Option(min=1, help="How many cases.")] = 1,
    kind: Annotated[Kind | None, typer.Option(help="How many effects; any.")] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help=f"Which: {', '.join((*EFFECTS, *STRANGERS))}. Once for each."),
    ] = None,
    ratio: Annotated[
        float | None, typer.Option(min=0.1, help="Size in units of the detection floor; any.")
    ] = None,
    concealment: Annotated[
        Concealment | None, typer.Option(help="How it is concealed; any.")
    ] = None,
    rig: Annotated[
        str | None, typer.Option(help=f"One of {', '.join((*RIGS, *SCENES))}; any rig.")
    ] = None,
    style: Annotated[
        str | None,
        typer.Option(
            help=f"What is read, and how fast: {', '.join(STYLES)}; of a robot on its feet "
            f"{'; '.join(READS)}; any."
        ),
    ] = None,
    secret: Annotated[
        Path | None, typer.Option(help="File with the secret; made if missing. Default: OUT.secret")
    ] = None,
) -> None:
    """Write sealed cases with a concealed effect: of one-joint rigs, a leg, or a whole robot."""
    secret_path = secret or out.with_name(f"{out.name}.secret")
    out.mkdir(parents=True, exist_ok=True)
    if secret_path.resolve().is_relative_to(out.resolve()):
        raise typer.BadParameter(f"{secret_path} lies among the cases: put it elsewhere")
    words = _secret(secret_path)
    asked = Asked(
        kind=kind.value if kind else None,
        effects=tuple(effect or ()),
        ratio=ratio,
        concealment=concealment.value if concealment else None,
        rig=rig,
        style=style,
    )
    try:
        for index in track(range(count), description="writing cases"):
            write_case(out / f"case-{index + 1:04d}", seed + index, words, asked)
    except (ValueError, FileExistsError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None
    typer.echo(f"{count} cases in {out}; the secret that opens their keys is {secret_path}")
    typer.echo(f"next: busemu inspect {out}/case-0001/recordings/*.parquet")


if __name__ == "__main__":
    app()
