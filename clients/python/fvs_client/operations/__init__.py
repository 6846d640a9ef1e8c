"""What takes more than one request, written once for both clients (see ``fvs_client.effects``)."""
