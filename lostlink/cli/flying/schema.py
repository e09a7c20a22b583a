"""`lostlink schema`: the JSON Schema of scenario files."""

from __future__ import annotations

import click


@click.command(short_help="Print the JSON Schema of scenario files, for editors.")
def schema() -> None:
    """Print the JSON Schema of scenario files; docs/reference/scenario.md says how an editor takes it.

    \b
    Example:
      lostlink schema > scenario.schema.json
    """
    from bridge.scenario.schema.editor import schema_text

    click.echo(schema_text(), nl=False)
