# Generated from _async/__init__.py by `make generate`. Do not edit.
"""The asynchronous client: the source from which ``_sync`` is generated (``make generate``)."""
