"""The protocol between runners and their clients: the only part that workers and runners share."""
