"""``python -m fvs_client`` is ``fvs-client``."""

from fvs_client.cli import main

main()
