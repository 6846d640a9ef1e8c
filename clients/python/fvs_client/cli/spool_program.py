"""``fvs-client`` with the one command ``spool``, which starts sooner and in less memory than with all."""

from fvs_client.cli.program import program
from fvs_client.cli.spool import spool

app = program()
app.add_typer(spool, name="spool")
